"""`clutch-hil secure`: a bench on an encrypted network, and real peers of zenoh that it serves or refuses."""

import json
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import zenoh

from clutch_hil.live.network.certificates import Authority
from clutch_hil.live.network.lab_network import describe_roles, make_lab
from clutch_hil.live.tuning.inject import inject
from clutch_hil.live.tuning.tune import SilentError, request_parameters, set_parameters
from protocols.errors import InputError
from protocols.telemetry.feed import Feed, NoBenchError, ask, find_bench, list_benches
from protocols.telemetry.keys import Keys, make_bench_name
from protocols.telemetry.lab import check_name, choose_viewer_network, find_asker_name, read_lab
from protocols.telemetry.message import check_description, check_requests
from protocols.telemetry.session import open_consumer_session, open_publisher_session
from tests.clutch_hil.live.running import RATE, run_command
from tests.protocols.telemetry.benches import bench, collect_batches, wait_for_bench, wait_until

BUS = "local:lab"
GAIN = "torque.integral_gain"
REFUSED = 1.0  # s in which a peer that is let in is so; it takes 0.02


@dataclass(frozen=True)
class Lab:
    """A running bench, and the folder with the files of its network."""

    name: str
    folder: Path

    def file(self, role: str) -> str:
        return str(self.folder / f"{role}.json")


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """Plant and controller as services, reached by certificates alone."""
    with (
        tempfile.TemporaryDirectory(prefix="ch-") as folder,
        pytest.MonkeyPatch.context() as patch,
        ExitStack() as stack,
    ):
        patch.setenv("CLUTCH_HIL_BUS_DIR", folder)
        made = Lab(make_bench_name(BUS), Path(folder) / "lab")
        make_lab(made.folder, (), "ada", 2, overwrite=False)
        stack.enter_context(bench(BUS, "--rate", str(RATE), "--network", made.file("bench")))
        with open_consumer_session(made.file("viewer")) as session:
            assert wait_for_bench(session, BUS) == made.name
        yield made


@contextmanager
def peer(settings: Mapping[str, Any], path: Path) -> Iterator[zenoh.Session]:
    """A consumer with these settings of zenoh, as a file that `clutch-hil secure` might have written."""
    path.write_text(json.dumps(settings), encoding="utf-8")
    path.chmod(0o600)
    with open_consumer_session(str(path)) as session:
        yield session


def test_a_bench_that_is_not_there_is_told_with_its_address_and_file(tmp_path: Path) -> None:
    make_lab(tmp_path, ("192.0.2.7",), "ada", 2, overwrite=False)
    viewer = str(tmp_path / "viewer.json")
    sentence = (
        rf"start one at 192\.0\.2\.7 with clutch-hil up --network bench\.json, the file that was made with {viewer}"
    )
    with open_consumer_session(viewer) as session, pytest.raises(NoBenchError, match=sentence):
        find_bench(session, network=viewer)


def settings_of(path: str) -> dict[str, Any]:
    return json.loads(Path(path).read_text(encoding="utf-8"))


def test_a_viewer_reads_everything(lab: Lab) -> None:
    with open_consumer_session(lab.file("viewer")) as session, Feed(session, lab.name, live=True) as feed:
        batches = collect_batches(feed, lambda batches: all(batches.values()))
        assert feed.alive == {"plant": True, "controller": True}
        assert batches["plant"][0].first_row == 0  # from the history
        assert {entry["name"] for entry in request_parameters(session, lab.name, "controller")} >= {GAIN}
        assert (ask(session, Keys(lab.name, "plant").describe, check_description) or {})["names_checked"] is True


@pytest.mark.parametrize("name", ["viewer", "ada", "*"])
def test_a_viewer_that_changes_is_refused_whatever_name_it_gives(lab: Lab, name: str) -> None:
    """It asks the bench itself, as a program of its own would; the bench answers nothing and changes nothing."""
    with open_consumer_session(lab.file("viewer")) as session:
        wait_until(lambda: lab.name in list_benches(session), "the bench")
        before = value(session, lab.name)
        with pytest.raises(SilentError):
            set_parameters(session, lab.name, "controller", {GAIN: before + 0.01}, by=name)
        with pytest.raises(SilentError):
            inject(session, lab.name, {"oil.sump_temperature": 71.0}, {}, by=name)
        key = Keys(lab.name, "controller").change_by(name)
        assert not list(session.get(key, payload=json.dumps({"demand": "10 Nm"}), timeout=REFUSED))
        assert value(session, lab.name) == before
        asked = ask(session, Keys(lab.name, "controller").requests, check_requests)
        assert asked is not None
        assert "demand" not in {request["kind"] for request in asked}


def test_a_viewer_cannot_publish_as_the_bench(lab: Lab) -> None:
    with (
        open_consumer_session(lab.file("viewer")) as liar,
        open_consumer_session(lab.file("viewer")) as session,
        Feed(session, lab.name, live=True) as feed,
    ):
        collect_batches(feed, lambda batches: all(batches.values()))
        liar.put(Keys(lab.name, "plant").record, b"a row that never was")
        liar.put(Keys(lab.name, "plant").event, b"{}")
        queryable = liar.declare_queryable(Keys(lab.name, "plant").last, zenoh.handlers.FifoChannel(8))
        collect_batches(feed, lambda batches: len(batches["plant"]) > 20)
        assert not feed.rejections
        ask(session, Keys(lab.name, "plant").last, check_description)
        assert queryable.try_recv() is None


def test_the_operator_tunes_injects_and_demands_and_each_is_logged_with_name_and_time(lab: Lab) -> None:
    began = time.time()
    network = ("--bus", BUS, "--network", lab.file("operator"))
    tuned = run_command("tune", f"controller.{GAIN}=0.21", *network)
    assert "1 parameter changed, requested by ada" in tuned.stdout, tuned.output
    injected = run_command("inject", "oil.sump_temperature=71", *network)
    assert "requested by ada" in injected.stdout, injected.output
    with open_consumer_session(lab.file("operator")) as session:
        key = Keys(lab.name, "controller").change_by("ada")
        replies = list(session.get(key, payload=json.dumps({"demand": "10 Nm for a test"}), timeout=5.0))
        assert [reply.ok is not None for reply in replies] == [True]
        with Feed(session, lab.name, live=True) as feed:
            collect_batches(feed, lambda batches: all(batches.values()))
            requests = feed.read_requests()
    assert [(request["node"], request["kind"]) for request in requests] == [
        ("controller", "tune"), ("plant", "inject"), ("controller", "demand"),
    ]  # fmt: skip
    assert {(request["by"], request["checked"]) for request in requests} == {("ada", True)}
    assert all(began <= request["time"] <= time.time() for request in requests)
    assert [request.get("values") or request["demand"] for request in requests] == [
        {GAIN: 0.21}, {"oil.sump_temperature": 71.0}, "10 Nm for a test",
    ]  # fmt: skip


def test_the_operator_cannot_take_another_name(lab: Lab) -> None:
    with open_consumer_session(lab.file("operator")) as session:
        wait_until(lambda: lab.name in list_benches(session), "the bench")
        with pytest.raises(SilentError):
            set_parameters(session, lab.name, "controller", {GAIN: 0.22}, by="grace")


@pytest.mark.parametrize("command", [("tune", f"{GAIN}=0.2"), ("inject", "internal_leakage"), ("demand", "5")])
def test_the_command_of_a_viewer_says_why_it_does_not_try(lab: Lab, command: tuple[str, ...]) -> None:
    done = run_command(*command, "--bus", BUS, "--network", lab.file("viewer"))
    assert isinstance(done.exception, InputError)
    assert "is for the role viewer, which may not change anything; allowed is operator.json" in str(done.exception)


@pytest.mark.parametrize("fault", ["no certificate", "another authority", "no TLS"])
def test_a_peer_with_a_wrong_certificate_is_not_let_in(lab: Lab, tmp_path: Path, fault: str) -> None:
    settings = settings_of(lab.file("viewer"))
    tls = settings["transport"]["link"]["tls"]
    later = datetime.now(UTC) + timedelta(days=2)
    if fault == "no certificate":
        del tls["connect_certificate_base64"], tls["connect_private_key_base64"]
    elif fault == "another authority":  # which knows the bench, and signs for whom it likes
        own = tls["root_ca_certificate_base64"]
        settings = describe_roles(["127.0.0.1"], "ada", Authority(later), later)["operator"]
        settings["transport"]["link"]["tls"]["root_ca_certificate_base64"] = own
    else:
        settings["connect"]["endpoints"] = [end.replace("tls", "tcp") for end in settings["connect"]["endpoints"]]
        settings["transport"]["link"] = {}
    with peer(settings, tmp_path / "peer.json") as session:
        time.sleep(REFUSED)
        assert lab.name not in list_benches(session)  # others may have a bench without TLS on this machine
        assert fault == "no TLS" or not list(session.info.peers_zid())


@pytest.mark.parametrize(
    ("fault", "refused"), [("none", False), ("expired", True), ("not yet", True), ("no role", True)]
)
def test_a_certificate_of_the_right_authority_must_hold_now_and_have_a_role(
    tmp_path: Path, fault: str, refused: bool
) -> None:
    now = datetime.now(UTC)
    authority = Authority(now + timedelta(days=1), now - timedelta(days=3))
    files = describe_roles(["127.0.0.1"], "ada", authority, now + timedelta(days=1))
    begins = {"expired": -3, "not yet": 1}.get(fault, -1)
    ends = {"expired": -1, "not yet": 2}.get(fault, 1)
    # of what it signs now
    authority._begins, authority._expires = (now + timedelta(hours=begins), now + timedelta(hours=ends))
    visitor = describe_roles(
        ["127.0.0.1"], "mallory" if fault == "no role" else "ada", authority, now + timedelta(days=1)
    )
    bench_file = tmp_path / "bench.json"
    bench_file.write_text(json.dumps(files["bench"]), encoding="utf-8")
    bench_file.chmod(0o600)
    key = f"clutch-hil/b@{os.getpid()}/plant/alive"
    with (
        open_publisher_session(str(bench_file)) as served,
        peer(visitor["operator"], tmp_path / "peer.json") as session,
    ):
        token = served.liveliness().declare_token(key)
        time.sleep(REFUSED)
        assert ([str(r.ok.key_expr) for r in session.liveliness().get(key, timeout=1.0) if r.ok] == []) == refused
        token.undeclare()


def test_a_viewer_is_not_taken_for_a_bench(tmp_path: Path) -> None:
    """Its certificate is not that of a server: nobody connects to one who listens with it."""
    now = datetime.now(UTC)
    files = describe_roles(["127.0.0.1"], "ada", Authority(now + timedelta(days=1)), now + timedelta(days=1))
    liar = files["viewer"] | {"metadata": files["bench"]["metadata"], "listen": files["bench"]["listen"], "connect": {}}
    tls = liar["transport"]["link"]["tls"]
    for kind in ("certificate", "private_key"):
        tls[f"listen_{kind}_base64"] = tls[f"connect_{kind}_base64"]
    (tmp_path / "liar.json").write_text(json.dumps(liar), encoding="utf-8")
    (tmp_path / "liar.json").chmod(0o600)
    with (
        open_publisher_session(str(tmp_path / "liar.json")),
        peer(files["operator"], tmp_path / "peer.json") as session,
    ):
        time.sleep(REFUSED)
        assert not list(session.info.peers_zid())


def test_files_are_private_and_never_replaced_unasked(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    done = run_command("secure", str(folder), "--host", "127.0.0.1", "--operator", "ada", "--days", "30")
    assert "verdict: 3 files, to " in done.stdout, done.output
    files = {path.name: path for path in folder.iterdir()}
    assert set(files) == {"bench.json", "operator.json", "viewer.json"}
    assert {path.stat().st_mode & 0o777 for path in files.values()} == {0o600}
    assert folder.stat().st_mode & 0o777 == 0o700
    before = {name: path.read_bytes() for name, path in files.items()}
    again = run_command("secure", str(folder))
    assert "exists already" in str(again.exception)
    assert {name: path.read_bytes() for name, path in files.items()} == before
    assert run_command("secure", str(folder), "--overwrite").exit_code == 0
    assert all(path.read_bytes() != before[name] for name, path in files.items())
    lab = read_lab(str(files["operator.json"]))
    assert lab is not None
    assert timedelta(days=89) < lab.expires - datetime.now(UTC) <= timedelta(days=90)


def test_the_authority_leaves_no_key(tmp_path: Path) -> None:
    """So nobody makes a further certificate: each file has the key of its own role alone."""
    make_lab(tmp_path / "lab", (), "ada", 1, overwrite=False)
    keys = [
        [name for name in settings_of(str(path))["transport"]["link"]["tls"] if "key" in name]
        for path in sorted((tmp_path / "lab").iterdir())
    ]
    assert keys == [["listen_private_key_base64"], ["connect_private_key_base64"], ["connect_private_key_base64"]]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--days", "0"), "certificates cannot hold 0 days; allowed are 1 to 825"),
        (("--days", "9999"), "certificates cannot hold 9999 days"),
        (("--operator", "viewer"), "the operator cannot have the name viewer"),
        (("--operator", "a/b"), "name 'a/b' is not possible"),
        (("--operator", "*"), "name '*' is not possible"),
        (("--host", "not a host"), "host 'not a host' is not possible"),
        (("--host", "999.1.1.1"), "host '999.1.1.1' is not possible"),
        (("--host", "192.168.1"), "host '192.168.1' is not possible"),
        (("--host", "-bench"), "host '-bench' is not possible"),
        (("--host", "lab..bench"), "host 'lab..bench' is not possible"),
    ],
)
def test_a_wrong_option_of_secure_is_one_sentence_and_writes_nothing(
    tmp_path: Path, arguments: tuple[str, ...], sentence: str
) -> None:
    done = run_command("secure", str(tmp_path / "lab"), *arguments)
    assert isinstance(done.exception, InputError)
    assert sentence in str(done.exception)
    assert not (tmp_path / "lab").exists()


@pytest.mark.parametrize(
    ("host", "warnings"),
    [
        (
            "192.0.2.7",
            ["this machine does not have the address 192.0.2.7; the bench can be reached there only on the machine"],
        ),
        (
            "2001:db8::7",
            ["this machine does not have the address 2001:db8::7; the bench can be reached there only on the"],
        ),
        (
            "no-such-bench.invalid",
            ["the name no-such-bench.invalid is not known on this machine; others can connect only if"],
        ),
        ("127.0.0.1", []),
        ("localhost", []),
    ],
)
def test_a_host_that_is_not_this_machine_is_told(host: str, warnings: list[str], tmp_path: Path) -> None:
    """TEST-NET-1 (RFC 5737), the prefix for documentation (RFC 3849) and .invalid (RFC 2606) belong to nobody."""
    document, text, _, _ = make_lab(tmp_path, (host,), "ada", 1, overwrite=False)
    assert len(document["warnings"]) == len(warnings)
    for said, begin in zip(document["warnings"], warnings, strict=True):
        assert said.startswith(begin)
        assert f"warning: {said}" in text.splitlines()


def test_a_file_that_cannot_be_used_is_one_sentence(tmp_path: Path) -> None:
    make_lab(tmp_path, (), "ada", 1, overwrite=False)
    viewer = tmp_path / "viewer.json"
    assert choose_viewer_network(str(tmp_path / "bench.json")) == str(viewer)
    assert choose_viewer_network("tcp/1.2.3.4:7447") == "tcp/1.2.3.4:7447"
    with pytest.raises(InputError, match=r"bench\.json is for plant and controller"):
        open_consumer_session(str(tmp_path / "bench.json"))
    with pytest.raises(InputError, match="plant and controller need"):
        open_publisher_session(str(viewer))
    viewer.chmod(0o644)
    with pytest.raises(InputError, match="has a private key and the mode 0644; allowed is 0600"):
        read_lab(str(viewer))
    viewer.chmod(0o600)
    settings = settings_of(str(viewer))
    settings["metadata"]["expires"] = "2020-01-01T00:00:00+00:00"
    viewer.write_text(json.dumps(settings), encoding="utf-8")
    with pytest.raises(
        InputError, match=r"expired at 2020-01-01 00:00 UTC; renew it: clutch-hil secure .* --overwrite"
    ):
        read_lab(str(viewer))
    for text in (
        "",
        "[]",
        "{}",
        "[" * 5000,
        '{"metadata": {"role": 1, "name": "a", "expires": "2030-01-01"}}',
        "x" * (1 << 21),
    ):
        viewer.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"was not written by|has more than"):
            read_lab(str(viewer))
    with pytest.raises(InputError, match="does not exist"):
        read_lab(str(tmp_path / "none.json"))
    fifo = tmp_path / "fifo.json"
    os.mkfifo(fifo)
    with pytest.raises(InputError, match="does not exist"):
        read_lab(str(fifo))


def test_without_certificates_the_name_is_that_of_the_user() -> None:
    assert check_name(find_asker_name(None))
    assert read_lab("tcp/192.168.1.5:7447") is None


def value(session: zenoh.Session, name: str) -> float:
    return next(entry["value"] for entry in request_parameters(session, name, "controller") if entry["name"] == GAIN)
