"""Reading XML of unknown origin: no document types, hence no entities, and bounded in every direction."""

import xml.etree.ElementTree as ET
from xml.parsers import expat

from dgl_assets.robots.errors import RobotImportError

MAX_XML_BYTES = 16 * 1024 * 1024
MAX_ELEMENTS = 100_000
MAX_DEPTH = 32


def parse_xml(data: bytes, name: str) -> ET.Element:
    """Parse a file.

    Args:
        data: Its content.
        name: Its name, for messages.

    Raises:
        RobotImportError: If it is too large, too deep, no XML, or declares a document type.
    """
    if len(data) > MAX_XML_BYTES:
        raise RobotImportError(
            f"{name} has {len(data):,} bytes; at most {MAX_XML_BYTES:,} are read"
        )
    depth = count = 0

    def start(tag: str, _: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH or count > MAX_ELEMENTS:
            raise RobotImportError(
                f"{name} nests or repeats its elements too much (at {tag!r}); at most {MAX_DEPTH} "
                f"levels and {MAX_ELEMENTS:,} elements are read"
            )

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*_: object) -> None:
        raise RobotImportError(
            f"{name} declares a document type or entities, which are not read; remove <!DOCTYPE ...>"
        )

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return ET.fromstring(data)
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as err:
        raise RobotImportError(f"{name} is not valid XML: {err}") from err
