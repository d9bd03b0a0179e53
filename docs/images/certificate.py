"""Draw the certificate that the docs show: `PYTHONPATH=. python docs/images/certificate.py`.

All pages side by side, in each language, of a short simulated run: a draft. Needs the packages of
the tests, and a font with Chinese signs. A folder as argument takes the pictures instead of this
one.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "support"))

from certified_run import ROOM, TYPED, measured  # noqa: E402
from PIL import Image  # noqa: E402

from station.report.certificate import certificate_of_run, sheet_of  # noqa: E402
from station.report.pdf import render_pages  # noqa: E402
from station.runner.evaluation import evaluate_run  # noqa: E402
from station.texts import ENGLISH, Texts, languages  # noqa: E402

PPI = 104.0
COLOURS = 48
"""A page has few colours; so a picture takes a third of the room."""


def main() -> None:
    """Run the short plan with all that a certificate asks for, and draw its certificate."""
    pictures = Path(sys.argv[1]) if sys.argv[1:] else HERE
    with tempfile.TemporaryDirectory() as parent:
        folder = measured(Path(parent) / "run", {}, {"room": ROOM}, TYPED)
        sheet = sheet_of(certificate_of_run(folder, evaluate_run(folder)[0]))
    for language in languages():
        pages = render_pages(sheet.translated(Texts(language)), ppi=PPI)
        ending = "" if language == ENGLISH else f"-{language}"
        side_by_side(pages).save(pictures / f"certificate{ending}.png", optimize=True)


def side_by_side(pages: list[bytes]) -> Image.Image:
    """Return pages as a picture of few colours."""
    drawn = [Image.open(io.BytesIO(page)).convert("RGB") for page in pages]
    width, height = (sum(page.width for page in drawn), max(page.height for page in drawn))
    whole = Image.new("RGB", (width, height), "white")
    place = 0
    for page in drawn:
        whole.paste(page, (place, 0))
        place += page.width
    return whole.quantize(COLOURS)


if __name__ == "__main__":
    main()
