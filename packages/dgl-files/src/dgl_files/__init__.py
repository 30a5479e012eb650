"""Files that are whole, typed and checked: what all packages share when they read and write."""

from dgl_files.fields import (
    STRICT,
    check_fields,
    check_value,
    decode_json,
    from_plain,
    show,
    tell,
)

__all__ = ["STRICT", "check_fields", "check_value", "decode_json", "from_plain", "show", "tell"]
