"""Conventions of the package: sizes, parameters, names, docstrings with units, texts of the help.

A list of exceptions may only become shorter: an entry that is no longer needed fails the test too.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer

import trackprofile
from trackprofile.cli import app

PACKAGE = Path(trackprofile.__file__).parent
MANUAL = Path(__file__).parents[1] / "docs"
MODULES = {
    path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8")
    for path in sorted(PACKAGE.rglob("*.py"))
}
TREES = {module: ast.parse(source) for module, source in MODULES.items()}
Function = ast.FunctionDef | ast.AsyncFunctionDef

LONGEST_MODULE, LONGEST_FUNCTION = 400, 60  # lines
MOST_POSITIONAL_PARAMETERS = 6
MOST_ROOT_MODULES, MOST_INFERENCE_MODULES = 12, 20

LONG_MODULES: set[str] = set()
LONG_FUNCTIONS: set[str] = set()
MANY_POSITIONAL_PARAMETERS: set[str] = set()
MIRRORED_MODULES = {
    "assess", "calibrate", "compare", "fuse", "infer", "report", "serve", "simulate", "store", "trend",
}  # fmt: skip
"""Modules of `cli` with the name of their command; each calls the module of the same name."""
EQUAL_CLASSES = {
    "Evaluation": "an option of the command line, and the setting of the method that it chooses",
}
"""Classes of one name with one meaning, and why there are two."""
UNDOCUMENTED_PARAMETERS = {
    "write: dataset",
    "write: path",
}
PARAMETERS_WITHOUT_UNIT: set[str] = set()
UNITS = (
    "m", "mm", "km", "m/s", "m/s²", "m²", "1/m", "rad", "rad/s", "rad/m", "m² rad/m", "°", "Hz", "s", "kg", "kg/m",
    "kg m²", "N", "N/m", "N s/m", "N m²", "N m/rad", "%", "dimensionless",
)  # fmt: skip
UNIT = re.compile(
    rf"(?:^|, |\[|\()(?:{'|'.join(map(re.escape, UNITS))})(?:$|[\],;:.)/]| or | per )"
)
NUMBER = re.compile(r"\b(float|Array|ArrayLike|NDArray)\b")
PRIVATE_WORDS = re.compile(
    r"\b(anyway|beside|told|said|laid|doubted|picture|how sure|obliges|whereabouts)\b",
    re.IGNORECASE,
)
COMMANDS = typer.main.get_command(app)


def check_exceptions(violations: set[str], exceptions: set[str]) -> None:
    """Every violation is an exception, and every exception is still needed."""
    assert violations - exceptions == set()
    assert exceptions - violations == set(), "no longer needed: remove it from the list"


def functions() -> Iterator[tuple[str, Function]]:
    """Every function of the package, with its name as in the lists above."""
    for module, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, Function):
                yield f"{module}:{node.name}", node


def commands(command: Any = COMMANDS, name: str = "trackprofile") -> Iterator[tuple[str, Any]]:
    """Every command of the command line, with its full name."""
    yield name, command
    for below in getattr(command, "commands", {}).values():
        yield from commands(below, f"{name} {below.name}")


def callbacks(command: typer.Typer) -> set[str]:
    """The functions of all commands, by module and name."""
    names = {
        f"{one.callback.__module__}.{one.callback.__name__}"
        for one in command.registered_commands
        if one.callback is not None
    }
    groups = (group.typer_instance for group in command.registered_groups)
    return names.union(*(callbacks(group) for group in groups if group is not None))


COMMAND_FUNCTIONS = callbacks(app)


def is_command(name: str) -> bool:
    """Whether the parameters of a function are options of the command line, which are passed by name."""
    module, _, function = name.partition(":")
    dotted = module.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    return f"trackprofile.{dotted}.{function}" in COMMAND_FUNCTIONS


def is_compiled(node: Function) -> bool:
    """Whether a function is a compiled kernel, which takes arrays and numbers one by one."""
    return any(re.match(r"(numba\.)?n?jit|compiled", ast.unparse(d)) for d in node.decorator_list)


def lines_of_code(name: str, node: Function) -> int:
    """Lines of a function without its docstring; of a command without its options."""
    lines = (node.end_lineno or node.lineno) - node.lineno + 1
    if ast.get_docstring(node):
        lines -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
    return lines - (node.body[0].lineno - node.lineno if is_command(name) else 0)


def test_modules_are_short() -> None:
    long = {name for name, text in MODULES.items() if text.count("\n") > LONGEST_MODULE}
    check_exceptions(long, LONG_MODULES)


def test_functions_are_short() -> None:
    long = {name for name, node in functions() if lines_of_code(name, node) > LONGEST_FUNCTION}
    check_exceptions(long, LONG_FUNCTIONS)


def test_functions_have_few_positional_parameters() -> None:
    many = set()
    for name, node in functions():
        positional = [one.arg for one in (*node.args.posonlyargs, *node.args.args)]
        count = len(positional) - (positional[:1] in (["self"], ["cls"]))
        if count > MOST_POSITIONAL_PARAMETERS and not (is_compiled(node) or is_command(name)):
            many.add(name)
    check_exceptions(many, MANY_POSITIONAL_PARAMETERS)


def test_root_and_inference_have_few_modules() -> None:
    assert len([name for name in MODULES if "/" not in name]) <= MOST_ROOT_MODULES
    assert (
        len([name for name in MODULES if name.startswith("inference/")]) <= MOST_INFERENCE_MODULES
    )


def test_no_two_modules_have_one_name() -> None:
    places = defaultdict(list)
    for module in MODULES:
        path = Path(module)
        if path.stem != "__init__":
            places[path.stem].append(path.parent.as_posix())
    several = {name: where for name, where in places.items() if len(where) > 1}
    check_exceptions(set(several), MIRRORED_MODULES)
    assert all("cli" in where and len(where) == 2 for where in several.values())


def test_no_two_classes_of_one_name_have_different_meanings() -> None:
    places = defaultdict(list)
    for module, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module)
    check_exceptions({name for name, where in places.items() if len(where) > 1}, set(EQUAL_CLASSES))


def documented_modules() -> list[str]:
    """The modules that the manual's reference describes."""
    pages = [path.read_text(encoding="utf-8") for path in sorted((MANUAL / "api").glob("*.md"))]
    return sorted({one for page in pages for one in re.findall(r"automodule:: ([\w.]+)", page)})


@pytest.mark.parametrize("name", documented_modules())
def test_every_name_in_the_reference_has_a_docstring(name: str) -> None:
    module = import_module(name)
    assert inspect.getdoc(module)
    missing = []
    for one, value in vars(module).items():
        if one.startswith("_") or getattr(value, "__module__", None) != name:
            continue
        if inspect.isclass(value) or inspect.isfunction(value):
            # A dataclass without a docstring is given its signature as one.
            text = value.__doc__ or ""
            if not text.strip() or text.startswith(f"{value.__name__}("):
                missing.append(one)
    assert missing == []


def public_functions() -> list[str]:
    """The names of the top level that can be called."""
    return sorted(name for name in trackprofile.__all__ if callable(getattr(trackprofile, name)))


def documented_parameters(value: Any) -> dict[str, str]:
    """The entries of a docstring's section "Parameters", by parameter."""
    text = inspect.getdoc(value) or ""
    match = re.search(
        r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)", text, re.MULTILINE | re.DOTALL
    )
    entries: dict[str, str] = {}
    names: list[str] = []
    for line in (match[1] if match else "").splitlines():
        head = re.fullmatch(r"(\w[\w, ]*) : (.*)", line)
        if head:
            names = head[1].split(", ")
            entries |= dict.fromkeys(names, head[2])
        elif line.startswith(" "):
            entries |= {name: f"{entries[name]} {line.strip()}" for name in names}
    return entries


@pytest.mark.parametrize("name", public_functions())
def test_every_public_name_has_a_docstring(name: str) -> None:
    value = getattr(trackprofile, name)
    assert (value.__doc__ or "").strip()
    assert not value.__doc__.startswith(f"{name}(")
    if dataclasses.is_dataclass(value):
        assert not {f.name for f in dataclasses.fields(value)} - set(documented_parameters(value))


def test_every_public_parameter_is_documented() -> None:
    missing = set()
    for name in public_functions():
        value = getattr(trackprofile, name)
        documented = documented_parameters(value)
        missing |= {
            f"{name}: {one}" for one in inspect.signature(value).parameters if one not in documented
        }
    check_exceptions(missing, UNDOCUMENTED_PARAMETERS)


def test_every_public_number_has_a_unit() -> None:
    without = set()
    for name in public_functions():
        value = getattr(trackprofile, name)
        parameters = inspect.signature(value).parameters
        for one, text in documented_parameters(value).items():
            annotation = str(parameters[one].annotation) if one in parameters else ""
            if NUMBER.search(annotation) and "Callable" not in annotation and not UNIT.search(text):
                without.add(f"{name}: {one}")
    check_exceptions(without, PARAMETERS_WITHOUT_UNIT)


@pytest.mark.parametrize(
    ("text", "has_unit"),
    [
        ("speed of the line, m/s", True),
        ("distance, (n,) [m]; None is the recording's own", True),
        ("gain of the sensor, dimensionless", True),
        ("the train's speed", False),
        ("as it was measured", False),
    ],
)
def test_unit_is_recognised(text: str, has_unit: bool) -> None:
    assert bool(UNIT.search(text)) is has_unit


def help_texts() -> Iterator[tuple[str, str]]:
    """Every text of the help: of commands, options and arguments."""
    for name, command in commands():
        yield name, command.help or ""
        for parameter in command.params:
            yield f"{name} {parameter.opts[0]}", getattr(parameter, "help", None) or ""


def test_help_uses_no_private_words() -> None:
    assert {name: text for name, text in help_texts() if PRIVATE_WORDS.search(text)} == {}


def test_no_help_begins_with_of() -> None:
    assert {name: text for name, text in help_texts() if text.startswith("Of ")} == {}


def test_every_option_has_a_help_text() -> None:
    assert [name for name, text in help_texts() if not text.strip()] == []


def test_no_option_uses_a_private_word() -> None:
    names = {
        option
        for _, command in commands()
        for parameter in command.params
        if parameter.param_type_name == "option"
        for option in parameter.opts
    }
    assert "--vehicle" in names
    assert {one for one in names if PRIVATE_WORDS.search(one.replace("-", " "))} == set()
