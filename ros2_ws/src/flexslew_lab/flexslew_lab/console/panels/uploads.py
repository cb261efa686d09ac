"""Models of appendages and measurements that a page uploads: `import` and `identify` of them."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from html import escape
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, NamedTuple

from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.forms import FormKey, set_options, value_of
from flexslew_lab.console.gate import FILES
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.uploads import FOLDER, stored
from flexslew_lab.identification.files import READERS
from flexslew_lab.identification.records.file_experiment import FileColumns, experiment_of_file
from flexslew_lab.named import names_in
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import one_line
from flexslew_plant.settings import validated
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.model import MODEL_UNITS
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import MODEL_ENDINGS

_NONE = "no file uploaded yet"
_ENDINGS = tuple(dict.fromkeys((*MODEL_ENDINGS, *READERS)))
_MODES = "Modes kept"


class _Found(NamedTuple):
    page: str  # HTML
    file: str  # below the folder of uploads
    write: Callable[[Path], object]  # writes that file
    rows: list[str]  # the few numbers that the panel shows


class UploadsPanel:
    """Files of other programs: uploaded, then imported or identified in a thread of its own.

    Args:
        context: desk of the page.
        files: files that the gate serves, by name.
    """

    def __init__(self, context: PanelContext, files: dict[str, Path]) -> None:
        gui = context.gui
        self._files, self._folder = files, context.link.folder
        self._stored: dict[str, Path] = {}
        with gui.folder("Files of other programs"):
            self._upload = gui.upload("Models and measurements", _ENDINGS)
            context.change(self._upload, self._take)
            self._which = gui.choice("Uploaded file", (_NONE,))
            self._hinge = gui.text("Nodes of the hinge", hint="as --boundary: 7,9-12, sets, x=0")
            self._modes = gui.text(_MODES, "8", hint="the slowest")
            self._units = gui.choice("Units of the model", tuple(MODEL_UNITS))
            context.click(gui.button("Import the model", hint="as flexslew import"), self._import)
            self._inputs = gui.text("Efforts in the file", hint="as --inputs: u=hub")
            self._outputs = gui.text("Sensors in the file", hint="as --outputs: x=position.hub")
            identify = gui.button("Identify the file", hint="as flexslew identify")
            context.click(identify, self._identify)
            self._reply, self._rows = ReplyLine(context), gui.html()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="uploads")
        self._job: tuple[str, Future[_Found]] | None = None

    def refresh(self) -> None:
        """List the files, and show what was found in one."""
        set_options(self._which, tuple(self._stored), _NONE)
        if self._job is None or not self._job[1].done():
            return
        (page, done), self._job = self._job, None
        try:
            found = done.result()
            place = self._place() / FOLDER
            found.write(place / found.file)
            self._files[page] = place / page
            self._files[page].write_text(found.page, encoding="utf-8")
        except Exception as error:  # of a file of anybody; the page goes on
            words = str(error) if isinstance(error, BadInput | OSError) else one_line(error)
            self._reply.tell(RequestResult(False, words))
            return
        self._reply.tell(RequestResult(True, f"written {place / found.file}"))
        link = f'<a href="{FILES}{escape(page)}" target="_blank" rel="noopener">Open the page</a>'
        self._rows.content = link + "".join(line(row) for row in found.rows)

    def _place(self) -> Path:
        """Return the folder of the run, or a new one for a bench whose folder is unknown."""
        self._folder = self._folder or mkdtemp(prefix="flexslew-")
        return Path(self._folder)

    def _take(self, who: str) -> None:
        """Store what the pages have sent."""
        while self._upload.value:
            file = self._upload.value.popleft()
            try:
                path = stored(self._place(), file, _ENDINGS)
            except (BadInput, OSError) as error:
                self._reply.tell(RequestResult(False, str(error)))
                continue
            self._stored[path.name] = path
            set_options(self._which, tuple(self._stored), _NONE)
            self._which.value = path.name
            self._reply.tell(RequestResult(True, f"{path.name} is in {path.parent}"))

    def _import(self, who: str) -> None:
        self._begin("import.html", lambda path: partial(_imported, path, self._options()))

    def _options(self) -> ImportOptions:
        modes = value_of(FormKey(_MODES), str(self._modes.value))
        if not isinstance(modes, int) or not 1 <= modes <= 200:
            raise BadInput("a whole number from 1 to 200", key=_MODES, value=modes)
        entries = tuple(names_in(str(self._hinge.value)))
        return ImportOptions(entries, modes, str(self._units.value))

    def _identify(self, who: str) -> None:
        self._begin("identified.html", lambda path: partial(_identified, path, self._columns()))

    def _columns(self) -> FileColumns:
        names = {"inputs": self._inputs, "outputs": self._outputs}
        values = {key: list(names_in(str(field.value))) for key, field in names.items()}
        for key, field in names.items():
            if not values[key]:
                raise BadInput(f"names of columns, {field.hint}", key=field.label, value="")
        columns: FileColumns = validated(FileColumns, values, "")
        return columns

    def _begin(self, page: str, job: Callable[[Path], Callable[[], _Found]]) -> None:
        """Start the work on the chosen file, if none is under way."""
        if self._job is not None:
            return
        try:
            path = self._stored.get(str(self._which.value))
            if path is None:
                raise BadInput("upload a file first")
            begun: Any = job(path)
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        self._reply.tell(RequestResult(True, "reading ..."))
        self._job = page, self._worker.submit(begun)


def _imported(path: Path, options: ImportOptions) -> _Found:
    """Return the modal data of a model.

    Raises:
        BadInput: see import_model.
    """
    from flexslew_lab.finite_elements.modal_output import write_modal_data
    from flexslew_lab.finite_elements.page import import_page
    from flexslew_lab.finite_elements.tables import verdict

    found = import_model(path, options)
    rows = [verdict(found), *(f"warning: {doubt}" for doubt in found.doubts)]
    write = partial(write_modal_data, found.content)
    return _Found(import_page(found, path.name), f"{path.stem}.modal.yaml", write, rows)


def _identified(path: Path, columns: FileColumns) -> _Found:
    """Return the model of measurements.

    Raises:
        BadInput: see experiment_of_file and identify.
    """
    from flexslew_lab.identification.identification import identify
    from flexslew_lab.identification.model_file import file_text, write_model
    from flexslew_lab.identification.page import identification_page, summary_rows, verdict

    experiment, notes = experiment_of_file(path, columns)
    found = identify([experiment])
    text, missing = file_text(found.model, None)
    rows = [*(f"warning: {note}" for note in notes), verdict(found)]
    rows += [": ".join(map(str, row)) for row in summary_rows(found)]
    rows += [f"no model to plan with: {missing}"] if missing else []

    def write(place: Path) -> None:
        write_model(place, text)

    return _Found(identification_page(found), f"{path.stem}.identified.yaml", write, rows)
