"""The parts in which `./flexslew test` runs the tests: without ROS, over ROS, and alone."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

OVER_ROS = ("tests/ros", "tests/campaigns/ros")
# Each with processes of its own, as a process keeps all machine code that it has loaded
GROUPS = ("tests/control", "tests/lab", "tests/lab/studies")
OPTIONAL_MARKERS = ("ros", "browser", "campaign", "matrix", "slow")
NO_TESTS_EXIT_CODE = 5  # pytest's exit code
_MOST = 8  # processes that compute, of three quarters of a gigabyte each
# pytest answers these without a test
_QUERIES = ("help", "markers", "showfixtures", "show_fixtures_per_test", "cacheshow")


class Selection(NamedTuple):
    """What the arguments of the command select."""

    paths: tuple[str, ...] = ()
    options: tuple[str, ...] = ()  # all other arguments, in their order
    markers: str = ""  # the expression of -m
    cases: bool = False  # a number of random cases is given
    stops: bool = False  # at a failure: -x, --maxfail
    debug: bool = False  # --pdb, which needs the terminal

    def expression(self, all_tests: bool) -> str:
        """Return the marker expression; a file that is named runs whole, as do given cases."""
        files = bool(self.paths) and all(Path(p.split("::")[0]).is_file() for p in self.paths)
        if self.markers:
            return f"({self.markers})"
        return "" if all_tests or files or self.cases else f"not ({' or '.join(OPTIONAL_MARKERS)})"


def read_selection(arguments: Sequence[str]) -> Selection | int:
    """Return what arguments select, or the exit code if pytest ends without a test.

    pytest itself parses them in the current folder, so that its own, the plugins' and the tests'
    options are known.
    """
    import pytest

    class Reader:
        config: pytest.Config | None = None

        @pytest.hookimpl(tryfirst=True)
        def pytest_cmdline_main(self, config: pytest.Config) -> int | None:
            if any(config.getoption(query, False) for query in _QUERIES):
                return None
            self.config = config
            return 0

    reader = Reader()
    code = pytest.main([*arguments], plugins=[reader])
    if reader.config is None:
        return int(code)
    config, options = reader.config, [*arguments]
    given = config.args_source is pytest.Config.ArgsSource.ARGS
    paths = tuple(config.args) if given else ()
    for path in paths:
        del options[len(options) - 1 - options[::-1].index(path)]
    return Selection(
        paths,
        tuple(options),
        config.getoption("markexpr", ""),
        config.getoption("cases", None) is not None,
        bool(config.getoption("maxfail", 0)),
        bool(config.getoption("usepdb", False)),
    )


def parts(selection: Selection, all_tests: bool) -> Iterator[tuple[str, ...]]:
    """Yield the arguments of pytest for each part that a selection needs.

    A long file without ROS is shared by workers. A file over ROS stays with one, and twice as many
    run, as benches wait more than they compute. The whole suite starts new workers for each of
    GROUPS, so that none needs more than 1.5 GB.
    """
    workers = min(os.cpu_count() or 2, _MOST)
    waiting = min(2 * workers, _MOST)
    if selection.debug:
        workers = waiting = 0
    ros = _selected_paths(selection.paths, OVER_ROS)
    options = selection.options
    expression = selection.expression(all_tests)
    marker_options = ("-m", expression) if expression else ()
    shared = ("-n", f"{workers}", "--dist", "worksteal", *options, *marker_options)
    separate: tuple[str, ...] = OVER_ROS
    if selection.paths or not all_tests:
        groups = [[path for path in selection.paths or ("tests",) if not _is_in(path, OVER_ROS)]]
    else:
        separate += GROUPS
        groups = [["tests"], *([group] for group in GROUPS)]
    for paths in filter(None, groups):
        ignored = [part for part in separate if part not in paths and _is_in_any(part, paths)]
        yield (*shared, *(f"--ignore={part}" for part in ignored), *paths)
    if ros:
        prefix = f"{expression} and " if expression else ""
        by_file = ("-n", f"{waiting}", "--dist", "loadfile")
        yield (*by_file, *options, "-m", f"{prefix}not alone", *ros)
        yield (*options, "-m", f"{prefix}alone", *ros)


def exit_code(codes: Sequence[int]) -> int:
    """Return the exit code of all parts; one that selects nothing fails only if all do."""
    return max((code for code in codes if code != NO_TESTS_EXIT_CODE), default=NO_TESTS_EXIT_CODE)


def _is_in_any(folder: str, paths: Sequence[str]) -> bool:
    """Return True if a folder is in one of the paths."""
    return _is_in(folder, [path.split("::")[0] for path in paths])


def _is_in(path: str, folders: Sequence[str]) -> bool:
    """Return True if a path, or the test in it, is in one of the folders."""
    place = Path(path.split("::")[0]).resolve()
    return any(place.is_relative_to(Path(folder).resolve()) for folder in folders)


def _selected_paths(paths: Sequence[str], folders: Sequence[str]) -> list[str]:
    """Return what paths select of folders: paths in one of them, and folders in one of the paths.

    Without paths, all folders.
    """
    if not paths:
        return [*folders]
    inner = (f for path in paths for f in folders if _is_in(f, [path.split("::")[0]]))
    return list(dict.fromkeys([*(path for path in paths if _is_in(path, folders)), *inner]))
