import ast
from pathlib import Path

from setuptools import find_packages, setup


def laws() -> list[str]:
    """Return the names of the laws, read from the entries at the ends of their files."""
    calls = (
        node
        for path in sorted(Path("flexslew_control/controllers").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "LawEntry"
    )
    return [ast.literal_eval(call.args[0]) for call in calls]


setup(
    name="flexslew_control",
    version="0.1.0",
    packages=find_packages(),
    package_data={"flexslew_control": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/flexslew_control"]),
        ("share/flexslew_control", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "planner = flexslew_control.ros.planner_node:main",
            "controller = flexslew_control.ros.controller_node:main",
            *(f"{name} = flexslew_control.ros.controller_node:main" for name in laws()),
        ]
    },
)
