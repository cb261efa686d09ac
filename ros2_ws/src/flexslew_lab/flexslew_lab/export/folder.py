"""The folder of an exported module: code, build file, test vector and its checker in C."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from flexslew_lab.export.c_module import CModule
from flexslew_lab.export.compiled import WARNINGS, compiler, run_compiler
from flexslew_lab.export.flight_vector import FlightVector, csv_of
from flexslew_plant.errors import BadInput

TOLERANCE, SINGLE_TOLERANCE = 1e-9, 1e-3  # of the largest output [-]

_CHECK = """/* Steps @NAME@ through a test vector of the bench and compares what comes out.

   usage: @NAME@_check @NAME@_vector.csv
   exit code 0: equal within the tolerance; 1: not; 2: no such file */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "@NAME@.h"

enum { INPUTS = @INPUTS@, OUTPUTS = @OUTPUTS@, MEMBERS = @MEMBERS@, LINE = 65536 };

static const int sizes[MEMBERS] = {@SIZES@};

static char line[LINE];

int main(int count, char **arguments)
{
    static @NAME@_memory memory;
    static @NAME@_@GIVEN@ given;
    static @NAME@_@RESULT@ result;
    @REAL@ in[INPUTS], out[OUTPUTS];
    double expected[OUTPUTS], peak[MEMBERS] = {0}, off[MEMBERS] = {0}, worst = 0.0;
    long ticks = 0;
    FILE *file = count > 1 ? fopen(arguments[1], "r") : NULL;
    if (file == NULL || fgets(line, LINE, file) == NULL) {
        (void)fprintf(stderr, "usage: @NAME@_check @NAME@_vector.csv\\n");
        return 2;
    }
    @NAME@_init(&memory);
    while (fgets(line, LINE, file) != NULL) {
        char *at = line;
        const int counted = strtod(at, &at) > 0.5;
        for (int k = 0; k < INPUTS; k++) {
            in[k] = (@REAL@)strtod(at + 1, &at);
        }
        for (int k = 0; k < OUTPUTS; k++) {
            expected[k] = strtod(at + 1, &at);
        }
        (void)memcpy(&given, in, sizeof given);
        @NAME@_step(&memory, &given, &result);
        (void)memcpy(out, &result, sizeof result);
        for (int member = 0, k = 0; counted && member < MEMBERS; member++) {
            for (const int end = k + sizes[member]; k < end; k++) {
                const double wrong = fabs((double)out[k] - expected[k]);
                off[member] = wrong <= off[member] ? off[member] : wrong;
                peak[member] = fmax(peak[member], fabs(expected[k]));
            }
        }
        ticks++;
    }
    (void)fclose(file);
    for (int member = 0; member < MEMBERS; member++) {
        const double share = peak[member] > 0.0 ? off[member] / peak[member] : off[member];
        worst = share <= worst ? worst : share;
    }
    (void)printf("%ld ticks, largest difference %.3g of the peak, allowed %g\\n", ticks, worst,
                 @TOLERANCE@);
    return worst <= @TOLERANCE@ ? 0 : 1;
}
"""
_CMAKE = """cmake_minimum_required(VERSION 3.13)
project(@NAME@ C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_EXTENSIONS OFF)
add_compile_options(-Wall -Wextra -Wconversion -Werror -pedantic -ffp-contract=off)
enable_testing()
"""
_TARGETS = """
add_library(@NAME@ STATIC @NAME@.c)
target_include_directories(@NAME@ PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
target_link_libraries(@NAME@ PUBLIC m)
add_executable(@NAME@_check @NAME@_check.c)
target_link_libraries(@NAME@_check PRIVATE @NAME@)
add_test(NAME @NAME@ COMMAND @NAME@_check ${CMAKE_CURRENT_SOURCE_DIR}/@NAME@_vector.csv)
"""


def write_folder(
    modules: Sequence[tuple[CModule, FlightVector]], folder: Path, single: bool = False
) -> tuple[Path, ...]:
    """Write modules with their build file, test vectors and checkers; return the files.

    Args:
        modules: the C code, and a vector of a flight of the bench, of each.
        folder: made if it is not there.
        single: whether the code is for float.
    """
    folder.mkdir(parents=True, exist_ok=True)
    texts, build = dict[str, str](), _filled(_CMAKE, {"NAME": modules[0][0].name})
    for module, vector in modules:
        given, result = module.structs
        words = {
            "NAME": module.name,
            "GIVEN": given,
            "RESULT": result,
            "INPUTS": str(sum(one.size for one in module.inputs)),
            "OUTPUTS": str(sum(one.size for one in module.outputs)),
            "MEMBERS": str(len(module.outputs)),
            "SIZES": ", ".join(str(one.size) for one in module.outputs),
            "REAL": "float" if single else "double",
            "TOLERANCE": str(SINGLE_TOLERANCE if single else TOLERANCE),
        }
        texts |= module.sources
        texts[f"{module.name}_check.c"] = _filled(_CHECK, words)
        texts[f"{module.name}_vector.csv"] = csv_of(module, vector)
        build += _filled(_TARGETS, words)
    texts["CMakeLists.txt"] = build
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return tuple(folder / name for name in texts)


def check_folder(module: CModule, folder: Path) -> str:
    """Compile a folder's code and checker and run them; return the checker's line.

    Raises:
        BadInput: there is no compiler, it refuses the code, or the outputs differ.
    """
    program = folder / f"{module.name}_check"
    files = [str(folder / f"{module.name}{end}") for end in (".c", "_check.c")]
    flags = [*WARNINGS, "-O2", "-ffp-contract=off", "-I", str(folder)]
    run_compiler([*compiler(), *flags, *files, "-o", str(program), "-lm"])
    vector = folder / f"{module.name}_vector.csv"
    done = subprocess.run([program, vector], capture_output=True, text=True, check=False)
    line = (done.stdout or done.stderr).strip()
    if done.returncode:
        raise BadInput(f"the code differs from the bench: {line}", str(vector))
    return line


def _filled(text: str, words: dict[str, str]) -> str:
    for key, word in words.items():
        text = text.replace(f"@{key}@", word)
    return text
