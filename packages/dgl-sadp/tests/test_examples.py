import importlib.util
from pathlib import Path

EXAMPLE = Path(__file__).parent.parent / "examples" / "read_windows.py"


def test_read_windows(tmp_path, make_episode):
    spec = importlib.util.spec_from_file_location("read_windows", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for number in range(4):
        make_episode(tmp_path / f"{number}.h5", frames=12, success=number != 3)
    result = module.main(tmp_path)
    assert result == {
        "episodes": 3,
        "failed": 1,
        "training_windows": 20,
        "validation_windows": 10,
        "action": (8, 60),
    }
