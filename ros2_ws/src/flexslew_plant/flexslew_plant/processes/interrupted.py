"""The exit code of a process after an interrupt that was caught."""


def keep_exit_code() -> None:
    """Let Python exit with our code, regardless of what an interrupt has cut short.

    One that leaves a text which `exec` runs, as dataclasses are made by, counts as unhandled even
    where it is caught further up, and Python would end itself by SIGINT in place of any exit code
    (CPython, run_eval_code_obj); the next text clears that.
    """
    exec("")
