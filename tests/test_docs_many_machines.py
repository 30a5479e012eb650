"""The page on many machines: its cluster file is of Ray's form, and its flags exist."""

import re
from pathlib import Path

import pytest
import yaml

from dexgarmentlab.cli.flags import WorkerFlags

PAGE = (Path(__file__).parent.parent / "docs/many_machines.md").read_text(encoding="utf-8")


def test_the_cluster_file_has_the_form_that_ray_asks_for():
    pytest.importorskip("ray")
    pytest.importorskip("jsonschema")
    from ray.autoscaler._private.util import prepare_config, validate_config

    content = yaml.safe_load(re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1])
    validate_config(prepare_config(content))
    with pytest.raises(Exception, match="no_such_key"):
        validate_config(prepare_config({**content, "no_such_key": 1}))


def test_every_flag_is_described():
    table = set(re.findall(r"^\| `(--[a-z-]+)", PAGE, re.MULTILINE))
    fields = {f"--{name.replace('_', '-')}" for name in WorkerFlags.__dataclass_fields__}
    assert table == fields
