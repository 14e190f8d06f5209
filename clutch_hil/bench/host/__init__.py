"""The computer of a bench: its set-up, its systemd units, and which sockets other machines can reach."""
