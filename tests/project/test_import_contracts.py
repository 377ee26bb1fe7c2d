"""Packages import in one direction only; public names are exactly ``__all__``; importing stays light."""

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

import tipforce

SOURCE = Path(tipforce.__file__).parent

BASE = {"types", "errors", "units"}
ALLOWED: dict[str, set[str]] = {
    "types": {"errors"},
    "errors": set(),
    "units": set(),
    "geometry": BASE,
    "mechanics": BASE | {"geometry"},
    "simulation": BASE | {"geometry", "mechanics"},
    "clinical": BASE,
    "control": BASE | {"clinical"},
    "limits": BASE | {"geometry", "mechanics", "simulation"},
    "vision": BASE | {"geometry"},
    "plausibility": BASE,
    "io": BASE | {"geometry", "plausibility"},
    "alignment": BASE | {"geometry", "vision", "io", "plausibility"},
    "annotation": BASE | {"geometry", "vision", "io"},
    "datasets": BASE | {"geometry", "vision", "io", "alignment"},
    "training": BASE | {"geometry", "vision"},
    "estimators": BASE | {"geometry", "vision", "io", "alignment", "datasets", "mechanics", "training"},
    "calibration": BASE | {"geometry", "vision", "io", "alignment", "mechanics", "estimators"},
    "evaluation": BASE | {"geometry", "vision", "io", "alignment", "datasets", "mechanics", "estimators", "clinical"},
    "hardware": BASE | {"io", "plausibility"},
    "live": BASE | {"clinical", "estimators", "io", "vision", "alignment"},
    "pipelines": BASE
    | {
        *(
            "geometry",
            "mechanics",
            "simulation",
            "limits",
            "vision",
            "plausibility",
            "io",
            "alignment",
            "datasets",
            "training",
        ),
        *("annotation", "estimators", "calibration", "clinical", "evaluation", "hardware", "live", "control"),
    },
}
"""docs/design.md draws this; what is not listed may not be imported."""


def packages() -> list[str]:
    """Packages and modules directly in ``tipforce``; a folder that holds nothing but old caches is none."""
    found = [path for path in SOURCE.iterdir() if not path.name.startswith("_")]
    return sorted(path.stem for path in found if path.suffix == ".py" or (path / "__init__.py").is_file())


def imported_packages(path: Path) -> set[str]:
    """Packages that ``path`` imports, relative or absolute, at any depth of its code."""
    package = ("tipforce", *path.relative_to(SOURCE).with_suffix("").parts)[:-1]
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else ()
            stem = ".".join((*start, *((node.module or "").split(".") if node.module else ())))
            names = [stem, *(f"{stem}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] == "tipforce" and len(parts) > 1:
                found.add(parts[1])
    return found & set(packages())


@pytest.mark.parametrize("package", [package for package in packages() if package != "cli"])
def test_a_package_imports_only_what_its_contract_allows(package: str) -> None:
    assert package in ALLOWED, f"{package} is new: give it a place in ALLOWED and in docs/design.md"
    paths = sorted((SOURCE / package).rglob("*.py")) or [SOURCE / f"{package}.py"]
    crossings = {str(p.relative_to(SOURCE)): imported_packages(p) - ALLOWED[package] - {package} for p in paths}
    assert not {path: broken for path, broken in crossings.items() if broken}


def test_a_broken_contract_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "tipforce" / "vision" / "deep" / "_bad.py"
    path.parent.mkdir(parents=True)
    path.write_text("def f():\n    from ...estimators import Svr\n    import tipforce.datasets\n")
    for package in ("estimators", "datasets"):
        (tmp_path / "tipforce" / package).mkdir()
        (tmp_path / "tipforce" / package / "__init__.py").touch()
    monkeypatch.setattr(sys.modules[__name__], "SOURCE", tmp_path / "tipforce")
    assert imported_packages(path) == {"estimators", "datasets"}


def modules(source: Path) -> dict[str, Path]:
    """Every module of the package in ``source``, by its full name."""
    found: dict[str, Path] = {}
    for path in source.rglob("*.py"):
        parts = (source.name, *path.relative_to(source).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported_modules(name: str, known: dict[str, Path]) -> set[str]:
    """Modules that ``name`` imports at any depth of its code, except for type checkers alone."""
    package = name.split(".") if known[name].name == "__init__.py" else name.split(".")[:-1]
    tree = ast.parse(known[name].read_text(encoding="utf-8"))
    for_types = {
        id(inner)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and "TYPE_CHECKING" in ast.unparse(block.test)
        for statement in block.body
        for inner in ast.walk(statement)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and id(node) not in for_types:
            start = package[: len(package) - node.level + 1] if node.level else []
            stem = ".".join((*start, *([node.module] if node.module else [])))
            for alias in node.names:
                found.add(f"{stem}.{alias.name}" if f"{stem}.{alias.name}" in known else stem)
    return found & set(known) - {name}


def circles(source: Path) -> list[list[str]]:
    """Groups of modules each of which imports the others, directly or through others."""
    known = modules(source)
    names = sorted(known)
    edges = np.zeros((len(names), len(names)), np.bool_)
    for row, name in enumerate(names):
        edges[row, [names.index(each) for each in imported_modules(name, known)]] = True
    count, group = connected_components(csr_matrix(edges), connection="strong")
    groups = [[names[k] for k in np.flatnonzero(group == number)] for number in range(count)]
    return [members for members in groups if len(members) > 1]


def test_no_module_imports_in_a_circle() -> None:
    """An import within a function hides a circle, and does not open it."""
    assert circles(SOURCE) == []


def test_a_circle_that_a_local_import_hides_is_found(tmp_path: Path) -> None:
    source = tmp_path / "tipforce"
    source.mkdir()
    (source / "__init__.py").touch()
    (source / "_one.py").write_text("from ._two import g\n")
    (source / "_two.py").write_text("def g():\n    from ._one import f\n")
    (source / "_three.py").write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ._four import h\n")
    (source / "_four.py").write_text("from ._three import g\n")
    assert circles(source) == [["tipforce._one", "tipforce._two"]]


def test_the_foreign_bench_shares_nothing_with_our_simulation() -> None:
    """Neither our rods nor our renderer: no import of them, and no private module of any package."""
    paths = sorted((SOURCE.parents[1] / "benchmarks").rglob("*.py"))
    assert paths
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            parts = [part for name in names if name.startswith("tipforce.") for part in name.split(".")[1:]]
            assert not {"simulation", "mechanics", "limits", "geometry"} & set(parts), path.name
            assert not [part for part in parts if part.startswith("_")], path.name


def public_packages() -> list[str]:
    return [
        "tipforce",
        *(
            m.name
            for m in pkgutil.iter_modules(tipforce.__path__, "tipforce.")
            if m.name != "tipforce.cli" and not m.name.startswith("tipforce._")
        ),
    ]


def lazily_imported(tree: ast.Module) -> list[ast.stmt]:
    """What stands under ``if TYPE_CHECKING``: names that are loaded when they are first used."""
    return [node for block in tree.body if isinstance(block, ast.If) for node in block.body]


@pytest.mark.parametrize("name", public_packages())
def test_public_names_are_exactly_dunder_all(name: str) -> None:
    module = importlib.import_module(name)
    exported = module.__all__
    assert len(exported) == len(set(exported))
    missing = [item for item in exported if not hasattr(module, item)]
    assert not missing
    if module.__file__ and Path(module.__file__).name == "__init__.py":
        children = {m.name for m in pkgutil.iter_modules(module.__path__)}
        tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
        taken = {
            alias.asname or alias.name
            for node in [*tree.body, *lazily_imported(tree)]
            if isinstance(node, ast.ImportFrom) and node.level
            for alias in node.names
        }
        assert {t for t in taken if not t.startswith("_")} - children == set(exported) - {"__version__"} - children


def test_only_packages_and_public_modules_have_dunder_all() -> None:
    public = {"__init__.py", *(f"{name.removeprefix('tipforce.')}.py" for name in public_packages())}
    private = [path for path in SOURCE.rglob("*.py") if path.name not in public]
    assert not [str(path.relative_to(SOURCE)) for path in private if "__all__ = " in path.read_text(encoding="utf-8")]


NEVER = ("torch", "monai", "onnx", "onnxscript", "onnxruntime")


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("tipforce", (*NEVER, "matplotlib", "sklearn", "av", "starlette", "numba")),
        ("tipforce.cli", (*NEVER, "matplotlib", "sklearn", "av", "starlette", "numba")),
        ("tipforce.training", NEVER),
        ("tipforce.estimators", (*NEVER, "sklearn", "scipy.signal", "scipy.stats", "matplotlib")),
        ("tipforce.simulation", (*NEVER, "sklearn", "scipy.signal", "scipy.stats", "matplotlib")),
        ("tipforce.evaluation", (*NEVER, "sklearn", "scipy.signal", "scipy.stats")),
    ],
)
def test_import_is_light(module: str, heavy: tuple[str, ...]) -> None:
    code = f"import sys, {module}; print([m for m in {heavy!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_no_file_is_too_long_to_be_read() -> None:
    sizes = {str(p.relative_to(SOURCE)): len(p.read_text(encoding="utf-8").splitlines()) for p in SOURCE.rglob("*.py")}
    assert not {path: lines for path, lines in sizes.items() if lines > 600}
