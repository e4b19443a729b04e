"""The types in sunglint/__init__.pyi and the docstrings beside the module: every public name, every signature (python/check runs this)."""

import ast
import inspect
import pathlib
import pydoc
import subprocess
import sys

import pytest

import sunglint as sg

PACKAGE = pathlib.Path(sg.__file__).parent
PUBLIC = sorted(n for n in sg.__all__ if not n.startswith("__"))


def public_callables():
    """Functions and the methods of classes, by their full names."""
    for name in PUBLIC:
        of = getattr(sg, name)
        yield name, of
        if inspect.isclass(of):
            for method, value in vars(of).items():
                if not method.startswith("_") and (callable(value) or isinstance(value, (property, classmethod))):
                    yield f"{name}.{method}", getattr(of, method)


def test_the_package_carries_its_types():
    assert (PACKAGE / "py.typed").exists() and (PACKAGE / "__init__.pyi").exists()


def test_the_types_name_what_is_there():
    """Truth: the names of the module, read by Python; those of the stub, read by ast."""
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text())
    stub = {n.name for n in tree.body if isinstance(n, (ast.FunctionDef, ast.ClassDef))}
    assert stub == set(PUBLIC)
    # What a person finds by dir() is public on purpose.
    assert {n for n in dir(sg) if not n.startswith("_")} - {"annotations"} == set(PUBLIC)


def test_stubtest_finds_no_difference(tmp_path):
    """Truth: mypy.stubtest, which imports the module and compares names, arguments and defaults with the stub."""
    command = [sys.executable, "-m", "mypy.stubtest", "sunglint", "--ignore-missing-stub"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_users_script_is_typed(tmp_path):
    """mypy knows the package's types (py.typed is found), and finds a wrong argument."""
    good = "import sunglint as sg\nx: float = sg.Brdf('a.bsdf').albedo(550.0)\ny: sg.Result = sg.Scene('a.toml').simulate(step_s=1.0)\n"
    bad = "import sunglint as sg\nsg.Scene('a.toml').simulate(step=1.0)\n"
    for name, text, errors in (("good", good, 0), ("bad", bad, 1)):
        script = tmp_path / f"{name}.py"
        script.write_text(text)
        done = subprocess.run([sys.executable, "-m", "mypy", "--strict", script], capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == errors, done.stdout
    assert "step" in done.stdout


@pytest.mark.parametrize("name, of", list(public_callables()), ids=[n for n, _ in public_callables()])
def test_every_public_name_is_documented(name, of):
    """numpydoc: a summary line of its own that ends with a stop; under Parameters stand all arguments and nothing else, of classes that a person makes, too."""
    text = inspect.getdoc(of)
    assert text, name
    summary = text.splitlines()[0]
    assert summary and summary[0].isupper() and summary.rstrip()[-1] in ".`:", f"{name}: {summary}"
    if isinstance(of, property):
        return
    target = of.__init__ if inspect.isclass(of) else of
    try:
        arguments = [p for p in inspect.signature(target).parameters if p != "self" and not p.startswith("_")]
    except (TypeError, ValueError):
        return
    listed = []
    if "\nParameters\n----------\n" in text:
        section = text.split("\nParameters\n----------\n", 1)[1].split("\n\n", 1)[0]
        for line in section.splitlines():
            if line and not line.startswith(" "):
                listed += [given.lstrip("*") for given in line.split(" : ")[0].split(", ")]
    elif inspect.isclass(of):
        # Results and the like are made by functions.
        return
    assert sorted(listed) == sorted(set(arguments)), f"{name}: {set(arguments) ^ set(listed)}"


def test_help_reads_well():
    """help() of the package and of each name: text, no object addresses."""
    for of in [sg, *(getattr(sg, n) for n in PUBLIC)]:
        text = pydoc.render_doc(of, renderer=pydoc.plaintext)
        assert " at 0x" not in text, text
        assert len(text) > 100
