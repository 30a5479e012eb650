"""Draw the first garments of every category into one picture each."""

from pathlib import Path

from dgl_assets import (
    draw_contact_sheet,
    garment_ids,
    list_categories,
    load_garment,
    save_picture,
)


def main(folder: Path = Path("catalogue"), *, count: int = 24, size: int = 200) -> list[Path]:
    """Write `folder`/<category>.png with `count` garments of all sizes each."""
    paths = []
    for category in list_categories():
        ids = garment_ids(category, "train", sizes="all", count=count)
        garments = [load_garment(garment_id) for garment_id in ids]
        sheet = draw_contact_sheet(garments, columns=8, size=size)
        paths.append(save_picture(sheet, folder / f"{category}.png"))
        print(paths[-1])
    return paths


if __name__ == "__main__":
    main()
