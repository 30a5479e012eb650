"""Make a garment of the catalogue, find a landmark on another one, and save it as OBJ."""

from pathlib import Path

from dgl_assets import correspond, load_garment


def main(path: Path = Path("top.obj")) -> Path:
    """Save garment 123 as OBJ and show where its left cuff is on another top."""
    top = load_garment("Tops_LongSleeve/000123")
    print(f"{top.name}: {len(top.vertices)} vertices, {top.extent[0]:.2f} x {top.extent[1]:.2f} m")

    other = load_garment("Tops_LongSleeve/000007")
    cuff = top.get_landmark_positions(("left_cuff",))
    there = correspond(top, cuff, other)
    print(f"left cuff {cuff[0].round(3)} is {there[0].round(3)} on {other.name}")

    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in top.vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in top.faces + 1]
    path.write_text("\n".join(lines) + "\n")
    return path


if __name__ == "__main__":
    main()
