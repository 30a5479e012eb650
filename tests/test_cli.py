"""The command line's own behaviour: finding verbs, help, and errors as exit statuses."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from dexgarmentlab import cli
from dexgarmentlab.cli import VERBS, Verb, console, main


@dataclass(frozen=True, kw_only=True)
class FailOptions:
    """Fail as asked.

    Example: dgl fail
    """

    times: int = 1
    """Number of times."""


@pytest.fixture
def failing(monkeypatch):
    """Give a verb `fail` that does what the test sets as its `run`."""
    module = SimpleNamespace(FailOptions=FailOptions, run=lambda options: 0)
    monkeypatch.setattr(cli, "VERBS", (Verb("fail", "fails"),))
    monkeypatch.setattr(Verb, "load", lambda self: module)
    return module


PROGRAM = "import sys; from dexgarmentlab.cli import main; sys.exit(main())"


def run_dgl(*words, environment, timeout=120):
    """Run the command line in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words],
        env=os.environ | environment,
        capture_output=True,
        timeout=timeout,
        check=False,
    )


def raises(error):
    def run(options):
        raise error

    return run


def test_help_names_every_verb(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {verb.name}" in text for verb in VERBS)


def test_without_a_verb_the_help_is_shown_and_the_status_tells(capsys):
    assert main([]) == 2
    assert "usage: dgl" in capsys.readouterr().out


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_every_verb_has_help_with_an_example(verb, capsys):
    assert main([verb.name, "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"usage: dgl {verb.name}" in text
    assert "Example" in text


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("dexgarmentlab 0.")


def test_an_unknown_verb_names_the_closest(capsys):
    assert main(["docter"]) == 2
    assert "Did you mean `dgl doctor`?" in capsys.readouterr().err


def test_a_verb_like_none_of_them_names_all(capsys):
    assert main(["qqqq"]) == 2
    error = capsys.readouterr().err
    assert "Did you mean" not in error
    assert "doctor" in error


def test_the_verbs_exit_status_is_returned(failing):
    failing.run = lambda options: 3 + options.times
    assert main(["fail"]) == 4
    assert main(["fail", "--times", "5"]) == 8


def test_what_libraries_print_is_no_result(failing, capsys):
    def run(options):
        print("Warp greets")  # noqa: T201 - as Warp does
        console.out_json({"times": options.times})
        return 0

    failing.run = run
    assert main(["fail"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"times": 1}
    assert captured.err == "Warp greets\n"
    console.out("after it")
    assert capsys.readouterr().out == "after it\n"


def test_a_wrong_option_is_a_usage_error(failing, capsys):
    assert main(["fail", "--tims", "5"]) == 2
    assert "--tims" in capsys.readouterr().err


def test_a_domain_error_is_one_line_without_traceback(failing, capsys):
    failing.run = raises(ValueError("faces must have shape (F, 3);\n got (120, 4)"))
    assert main(["fail"]) == 1
    assert capsys.readouterr().err == "dgl: faces must have shape (F, 3); got (120, 4)\n"


def test_debug_adds_the_traceback(failing, capsys):
    failing.run = raises(ValueError("wrong"))
    for arguments in (["--debug", "fail"], ["fail", "--debug"]):
        assert main(arguments) == 1
        assert "Traceback" in capsys.readouterr().err


def test_a_missing_file_is_a_domain_error(failing, capsys):
    failing.run = lambda options: Path("/nonexistent/episode.h5").read_bytes()
    assert main(["fail"]) == 1
    told = capsys.readouterr().err
    assert told == "dgl: No such file or directory: /nonexistent/episode.h5\n"


def test_errors_of_our_packages_are_domain_errors(failing, capsys):
    from dgl_sadp import DamagedEpisodeError

    failing.run = raises(DamagedEpisodeError(Path("a.h5"), "torn"))
    assert main(["fail"]) == 1
    assert "a.h5: torn" in capsys.readouterr().err


def test_any_other_exception_is_called_a_defect(failing, capsys):
    failing.run = raises(TypeError("no such thing"))
    assert main(["fail"]) == 70
    error = capsys.readouterr().err
    assert "internal error, TypeError: no such thing" in error
    assert "--debug" in error
    assert "Traceback" not in error


def test_an_interruption_has_its_own_status(failing, capsys):
    failing.run = raises(KeyboardInterrupt())
    assert main(["fail"]) == 130
    assert "interrupted" in capsys.readouterr().err


def test_verb_modules_import_heavy_packages_only_when_run():
    """`dgl VERB --help` is quick because the packages are imported inside of `run`."""
    modules = [f"dexgarmentlab.cli.{verb.name}" for verb in VERBS]
    probe = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    heavy = {"dgl_tasks", "dgl_physics", "torch", "sapien", "mani_skill", "warp", "h5py"}
    assert "dgl_collect" in loaded  # its options are flags
    assert loaded & heavy == set()


def test_every_module_that_is_a_verb_is_registered():
    folder = Path(cli.__file__).parent
    verbs = {
        path.stem
        for path in folder.glob("*.py")
        if "\ndef run(" in path.read_text(encoding="utf-8")
    }
    assert verbs == {verb.name for verb in VERBS}
    for verb in VERBS:
        assert hasattr(verb.load(), f"{verb.name.capitalize()}Options")


def test_a_cache_that_cannot_be_written_names_its_variable(failing, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/sys/none/.cache")
    failing.run = raises(PermissionError(13, "Permission denied", "/sys/none"))
    assert main(["fail"]) == 1
    error = capsys.readouterr().err
    assert "/sys/none/.cache: set XDG_CACHE_HOME to a folder that can be written to" in error
    failing.run = raises(PermissionError(13, "Permission denied", "/data/mine"))
    assert main(["fail"]) == 1
    assert "XDG_CACHE_HOME" not in capsys.readouterr().err


def test_help_in_a_terminal_of_one_column_is_laid_out_at_once():
    done = run_dgl("collect", "--help", environment={"COLUMNS": "1"}, timeout=60)
    assert done.returncode == 0
    assert len(done.stdout.splitlines()[0]) < 60


def test_a_closed_pipe_ends_quietly():
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "--help"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdout.close()
    assert process.wait(timeout=60) == 141
    assert process.stderr.read() == ""
    process.stderr.close()


def test_names_that_the_locale_cannot_write_are_told():
    ascii_locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    words = ("gam", "match", b"/none/\xc3\xa9\xff.npy", "b.npy", "--out", "m.png")
    for environment in (ascii_locale, {}):
        done = run_dgl(*words, environment=environment)
        assert done.returncode == 1
        assert b"/none/\xc3\xa9\xff.npy does not exist" in done.stderr
