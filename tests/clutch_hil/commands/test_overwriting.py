"""No command replaces a file unasked: whoever writes to a name that a person gives takes --overwrite."""

import typer.main

from clutch_hil.command import make_application

# Options that name a file, or a folder for files of fixed names
NAMED_OUTPUTS = {"out", "target", "save", "write", "junit", "summary", "ring", "file"}
# What they call `file` is read
READERS = {"replay"}


def test_every_command_that_writes_a_named_file_takes_overwrite() -> None:
    commands = typer.main.get_command(make_application()).commands  # type: ignore[attr-defined]
    lacking = [
        name
        for name, command in commands.items()
        if (options := {param.name for param in command.params}) & NAMED_OUTPUTS
        and "overwrite" not in options
        and name not in READERS
    ]
    assert lacking == []
    assert commands.keys() >= READERS
