"""Progress in logs: lines that say how far a work has come, neither too many nor too few."""

import io
import sys

import pytest

from dexgarmentlab.cli import console


@pytest.fixture
def clock():
    """A clock that stands until it is set, and what reads it."""

    class Clock:
        now = 100.0

        def __call__(self):
            return self.now

    return Clock()


def test_a_line_is_written_every_half_minute_and_says_where_it_is(clock, capsys):
    bar = console._LoggedProgress("training", None, clock=clock)
    for step in range(1, 91):
        clock.now = 100.0 + step
        bar.reach(2 * step, note=f"loss {step}", total=500)
    assert capsys.readouterr().err.splitlines() == [
        "training 60/500, 0:00:30, loss 30",
        "training 120/500, 0:01:00, loss 60",
        "training 180/500, 0:01:30, loss 90",
    ]
    clock.now += 29.9
    bar.advance()
    assert capsys.readouterr().err == ""
    clock.now += 0.1
    bar.advance()  # What is not given again stays.
    assert capsys.readouterr().err == "training 182/500, 0:02:00, loss 90\n"
    bar.end()
    assert capsys.readouterr().err == ""
    bar.advance()
    bar.end()
    assert capsys.readouterr().err == "training 183/500, 0:02:00, loss 90\n"


def test_where_it_ended_is_written_whatever_ended_it(capsys):
    with console.progress("building", 3) as bar:
        bar.advance()
    assert capsys.readouterr().err == "building 1/3, 0:00:00\n"

    def read():
        with console.progress("reading") as bar:
            bar.advance(2, note="second file")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read()
    captured = capsys.readouterr()
    assert captured.err == "reading 2, 0:00:00, second file\n"
    assert captured.out == ""


def test_a_terminal_has_a_bar_instead_of_lines(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with console.progress("building", 3) as bar:
        bar.advance(note="first")
    assert "\x1b[" in terminal.getvalue()
    assert "1/3" in terminal.getvalue()
