"""The verb `serve`, without weights and without a socket."""

import re

import pytest

from dexgarmentlab.cli import main
from dexgarmentlab.learned_methods import CheckpointMethod
from dgl_collect.remote import ServedStages


@pytest.fixture
def served(monkeypatch):
    """Servers that were made; each ends with an interrupt."""
    made = []

    class Server:
        port = 4321

        def __init__(self, make_served, *, host, port):
            if port == 1:
                raise PermissionError(13, "Permission denied")
            made.append((make_served(), host, port))

        def run(self):
            raise KeyboardInterrupt

        def stop(self):
            made.append("stopped")

    class Actor:
        policies = "policies"

    monkeypatch.setattr("dgl_collect.remote.PolicyServer", Server)
    monkeypatch.setattr(CheckpointMethod, "prepare", lambda self, task, options: Actor)
    return made


def test_a_policy_is_served_on_this_machine_alone_until_an_interrupt(served, capsys):
    assert main(["serve", "halo", "FoldTops-v1", "--port", "0"]) == 0
    assert "halo of FoldTops-v1 at ws://127.0.0.1:4321" in capsys.readouterr().out
    (halo, *where), stopped = served
    assert halo == ServedStages(
        policies="policies", task="FoldTops-v1", cloud="segmented", is_sent=True
    )
    assert where == ["127.0.0.1", 0]
    assert stopped == "stopped"


def test_primitives_of_the_box_are_served(served, capsys):
    for name in ("primitive", "blind"):
        assert main(["serve", name, "HangCoat-v1"]) == 0
        assert f"{name} of HangCoat-v1 at ws://127.0.0.1:4321" in capsys.readouterr().out
    primitive, blind = served[0][0], served[2][0]
    assert primitive.metadata == {"protocol": "dexgarmentlab.skill", "task": "HangCoat-v1"}
    assert (primitive.skill.is_blind, blind.skill.is_blind) == (False, True)


def test_what_cannot_be_served_is_told_in_a_line(served, capsys, monkeypatch):
    table = [
        (["halo", "FoldTops-v1", "--port", "65536"], "--port must be from 0 to 65535; got 65536"),
        (["halo", "FoldTops-v1", "--port", "1"], "cannot listen at 127.0.0.1:1: Permission"),
        (["halo", "FoldTop-v1"], "did you mean 'FoldTops-v1'"),
    ]
    for words, message in table:
        assert main(["serve", *words]) == 1
        assert re.search(message, capsys.readouterr().err)
    monkeypatch.undo()
    assert main(["serve", "halo", "StoreTops-v1"]) == 1
    assert "StoreTops-v1" in capsys.readouterr().err
