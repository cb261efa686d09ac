"""Files that a page uploads are imported and identified, or refused, as by the commands."""

import re
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from tests.browser import chromium
from tests.fake_bench import FakeLink
from tests.hands import Hands
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, arrays, saved
from tests.plant.testbeds.spacecraft.finite_elements.mode_files import rod_files

from flexslew_lab.console.page import Page
from flexslew_lab.console.uploads import FOLDER, MOST, UploadedFile, stored
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import LARGEST
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape
from flexslew_plant.yaml_data import load_yaml

RATE, RATIO, INERTIA = 5.0, 0.01, 2.0  # of the bench whose measurements are uploaded


@pytest.fixture
def hands(tmp_path: Path) -> Iterator[Hands]:
    """Yield a page over a bench whose run has a folder."""
    link = FakeLink(str(tmp_path / "run"))
    page = Page(link, "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json")
    yield Hands(page, link)
    page.close()


def upload(hands: Hands, *files: Path | UploadedFile) -> str:
    """Upload files, and return what then stands on the page."""
    (place,) = hands.elements("Models and measurements")
    for file in files:
        given = UploadedFile(file.name, file.read_bytes()) if isinstance(file, Path) else file
        place.value.append(given)
        hands._told(place.changed)
    return hands.texts()


def worked(hands: Hands, button: str) -> str:
    """Return what stands on the page after a click and all that it began."""
    assert hands.click(button) == []
    panel: Any = next(p for p in hands.page._panels if type(p).__name__ == "UploadsPanel")
    panel._worker.submit(lambda: None).result()
    hands.refresh()
    return hands.texts()


def test_an_uploaded_model_is_the_one_that_the_command_imports(
    hands: Hands, tmp_path: Path
) -> None:
    model = saved(tmp_path, **arrays(ANGLE, 2))
    assert f"{model.name} is in {tmp_path / 'run' / FOLDER}" in upload(hands, model)
    hands.set("Modes kept", "3")
    texts = worked(hands, "Import the model")
    assert 'href="/run/import.html"' in texts
    written = modal_shape(tmp_path / "run" / FOLDER / f"{model.stem}.modal.yaml")
    expected = import_model(model, ImportOptions((), 3))
    np.testing.assert_allclose(written.frequencies, expected.reduction.frequencies, rtol=1e-9)
    assert "Mode shapes" in hands.page.server.gate.files["import.html"].read_text()


def test_files_of_one_model_are_found_next_to_each_other(hands: Hands, tmp_path: Path) -> None:
    path = rod_files(tmp_path)
    upload(hands, path)
    assert "model.dat: cannot be read" in worked(hands, "Import the model")
    upload(hands, path.with_suffix(".dat"))
    hands.set("Uploaded file", path.name)
    hands.set("Modes kept", "2")
    assert "2 clamped modes" in worked(hands, "Import the model")


def test_uploaded_measurements_are_identified(hands: Hands, tmp_path: Path) -> None:
    """A hub of known inertia with one mode, shaken by white noise; exact between samples."""
    text = measurements()
    upload(hands, UploadedFile("lab.csv", text.encode()))
    hands.set("Efforts in the file", "u=hub")
    hands.set("Sensors in the file", "x=position.hub, v=rate.hub, s")
    texts = worked(hands, "Identify the file")
    assert 'href="/run/identified.html"' in texts, texts
    written = load_yaml((tmp_path / "run" / FOLDER / "lab.identified.yaml").read_text(), "lab")
    assert written["inertia"][0][0]["value"] == pytest.approx(INERTIA, rel=1e-5)
    appendage = written["appendage"]
    assert appendage["frequencies"] == pytest.approx([RATE], rel=1e-5)
    assert appendage["damping_ratios"] == pytest.approx([RATIO], rel=1e-3)


def measurements() -> str:
    """Return columns t, u, x, v, s of a hub with a flexible mode, as a CSV file."""
    coupling = 0.6
    mass = np.array([[INERTIA, coupling], [coupling, 1.0]])
    stiffness = np.diag([0.0, RATE**2])
    damping = np.diag([0.0, 2.0 * RATIO * RATE])
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    b = np.concatenate((np.zeros(2), inverse[:, 0]))
    step = 0.02
    held = expm(step * np.block([[a, b[:, None]], [np.zeros((1, 5))]]))
    rng = np.random.default_rng(5)
    state, rows = np.zeros(4), ["t,u,x,v,s"]
    for tick in range(4000):
        effort = float(rng.standard_normal())
        read = state + 1e-5 * rng.standard_normal(4)
        values = (step * tick, effort, read[0], read[2], read[1])
        rows.append(",".join(f"{value:.9g}" for value in values))
        state = held[:4, :4] @ state + held[:4, 4] * effort
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("../../x.npz", b"", "the name of a file has letters"),
        (".bashrc", b"", "the name of a file has letters"),
        ("a\nb.npz", b"", "the name of a file has letters"),
        (f"{'a' * 200}.npz", b"", "the name of a file has letters"),
        ("a.exe", b"", "a file ends in .npz"),
        ("a.sh.", b"", "the name of a file has letters"),
    ],
)
def test_a_name_that_is_not_allowed_is_refused_and_nothing_written(
    hands: Hands, tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert words in upload(hands, UploadedFile(name, content))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", ["a.npz", "a.mat", "a.op4", "a.frd", "a.csv", "a.uff"])
@pytest.mark.parametrize("content", [b"", b"\x00" * 99, b"PK\x03\x04", b"1,2\n", b"\xff" * 4096])
def test_hostile_content_is_refused_in_one_line_and_the_page_goes_on(
    hands: Hands, name: str, content: bytes
) -> None:
    upload(hands, UploadedFile(name, content))
    hands.set("Nodes of the hinge", "1")
    hands.set("Efforts in the file", "u=hub")
    hands.set("Sensors in the file", "x=position.hub")
    for button in ("Import the model", "Identify the file"):
        texts = worked(hands, button)
        assert "refused: " in texts
        assert "Traceback" not in texts


def test_a_file_that_is_too_large_and_one_too_many_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"a\.npz is larger than 64 MiB"):
        stored(tmp_path, UploadedFile("a.npz", bytes(LARGEST + 1)), (".npz",))
    for k in range(MOST):
        stored(tmp_path, UploadedFile(f"{k}.npz", b"x"), (".npz",))
    stored(tmp_path, UploadedFile("0.npz", b"again"), (".npz",))
    assert (tmp_path / FOLDER / "0.npz").read_bytes() == b"again"
    with pytest.raises(BadInput, match=f"has {MOST} files already"):
        stored(tmp_path, UploadedFile("more.npz", b""), (".npz",))


def test_fields_and_files_that_are_missing_are_named(hands: Hands) -> None:
    assert "refused: upload a file first" in worked(hands, "Import the model")
    upload(hands, UploadedFile("a.csv", b"t,u,x\n"))
    assert "Efforts in the file: &#x27;&#x27; is not allowed" in worked(hands, "Identify the file")
    hands.set("Modes kept", "many")
    assert "Modes kept: &#x27;many&#x27; is not allowed" in worked(hands, "Import the model")


def posted(page: Page, size: int | None, content: bytes = b"rods") -> int:
    """Return the status of an upload over HTTP as a browser sends it."""
    server = page.server
    own = f"http://127.0.0.1:{server.port}"
    connection = HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("GET", f"/?token={server.gate.token}")
    answer = connection.getresponse()
    body = answer.read().decode()
    path = re.search(r"/_nicegui/client/[^/]+/upload/\d+", body)
    assert path is not None
    form = b'--b\r\nContent-Disposition: form-data; name="f"; filename="a.npz"\r\n\r\n'
    form += content + b"\r\n--b--\r\n"
    connection.putrequest("POST", path[0])
    head = {"Cookie": answer.headers["Set-Cookie"].partition(";")[0], "Origin": own}
    head |= {"Content-Type": "multipart/form-data; boundary=b"}
    head |= {"Content-Length": str(len(form) if size is None else size)} if size != -1 else {}
    for name, value in head.items():
        connection.putheader(name, value)
    connection.endheaders(form if size is None else None)
    return connection.getresponse().status


def test_a_post_brings_the_file_and_one_that_is_too_long_is_not_read(
    hands: Hands, tmp_path: Path
) -> None:
    assert posted(hands.page, None) == 200
    hands.page._context.work()
    assert (tmp_path / "run" / FOLDER / "a.npz").read_bytes() == b"rods"
    assert posted(hands.page, LARGEST * 2) == 413
    assert posted(hands.page, -1) == 413


@pytest.mark.browser
def test_a_browser_uploads_and_imports(hands: Hands, tmp_path: Path) -> None:
    model, over = saved(tmp_path, **arrays(ANGLE, 2)), Event()
    serving = Thread(target=hands.page.serve, args=(over,))
    serving.start()
    try:
        with chromium() as browser:
            browser.open(hands.page.server.address, 1400)
            browser.until("return document.getElementById('bench-state')?.checkVisibility()")
            browser.click("//*[contains(@class,'q-tab')][.//text()='Experiment']")
            browser.choose("//input[@type='file']", model)
            browser.until(f"return document.body.innerText.includes('{model.name} is in')")
            browser.click("//button[.//text()='Import the model']")
            browser.until("return document.body.innerText.includes('clamped modes')")
    finally:
        over.set()
        serving.join()
    assert (tmp_path / "run" / FOLDER / f"{model.stem}.modal.yaml").is_file()
