"""The figures in `docs/gam.md` are those of the model card that is shipped."""

from pathlib import Path

import dgl_gam

ROOT = Path(__file__).resolve().parent.parent
CARD = Path(dgl_gam.__file__).parent / "weights" / "garments.md"
FOLDED = {
    "Dress_LongSleeve": "sleeve_folded", "Scarf": "end_folded", "Tops_FrontOpen": "sleeve_folded",
    "Tops_LongSleeve": "sleeve_folded", "Tops_NoSleeve": "side_folded", "Trousers": "leg_folded",
}  # fmt: skip
MEAN_ERROR, PCK05, PCK10, SWAPPED, AUROC = 3, 4, 5, 8, 10  # columns of the card
COLUMNS = (
    ("flat_30", MEAN_ERROR), ("flat_30", PCK05), ("flat_any", PCK05), ("flat_any", SWAPPED),
    ("noise_half", PCK05), ("noise_any", PCK05), ("dropped", PCK10), ("crumpled", PCK10),
    ("folded", PCK10), ("hung_two", PCK10),
    ("hung_two_any", PCK10), ("all", AUROC),
)  # fmt: skip


def read_rows(text: str, width: int) -> list[list[str]]:
    """Rows of the tables with so many columns, without headings."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    return [r for r in rows if len(r) == width and r[0] != "category" and not r[0].startswith("--")]


def test_the_table_of_the_documentation_is_that_of_the_card():
    card = {(row[0], row[1]): row for row in read_rows(CARD.read_text(encoding="utf-8"), 11)}
    documented = read_rows((ROOT / "docs" / "gam.md").read_text(encoding="utf-8"), 13)
    assert len(documented) == 11  # nine categories, round hats twice, and the mean
    for name, *cells in documented:
        category = "all" if name == "mean" else name
        for cell, (condition, column) in zip(cells, COLUMNS, strict=True):
            found = FOLDED.get(category, "") if condition == "folded" else condition
            row = card.get((category, found))
            assert cell == ("" if row is None else row[column]), (name, condition)
