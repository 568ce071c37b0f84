"""Each argument and each attribute of the public names is documented.

The other checks of numpydoc are in docs/conf.py and run with `make docs`.
"""

import dataclasses
import inspect
import re

import pytest

import pmalpha as pm

MODULES = [pm, *(getattr(pm, name) for name in pm.__all__ if inspect.ismodule(getattr(pm, name)))]
# Arrays with one attribute more: their constructor is NumPy's.
ARRAYS = {pm.analysis.AmplificationMatrix}


def public():
    """Classes and functions by full name, each once."""
    named = {}
    for module in MODULES:
        for name in module.__all__:
            thing = getattr(module, name)
            if not inspect.ismodule(thing) and callable(thing) and thing not in named.values():
                named[f"{module.__name__}.{name}"] = thing
    return named


PUBLIC = public()
CLASSES = {name: x for name, x in PUBLIC.items() if inspect.isclass(x) and x not in ARRAYS}


def methods(cls):
    """Public methods that are the package's own, by name."""
    return {
        name: x
        for name, x in inspect.getmembers(cls, callable)
        if not name.startswith("_") and getattr(x, "__module__", "").startswith("pmalpha")
    }


FUNCTIONS = {name: x for name, x in PUBLIC.items() if not inspect.isclass(x)}
FUNCTIONS |= {f"{name}.{m}": x for name, cls in CLASSES.items() for m, x in methods(cls).items()}


def sections(thing):
    return pytest.importorskip("numpydoc.docscrape").NumpyDocString(inspect.getdoc(thing) or "")


def documented(thing, *names):
    """The parameters or attributes in these sections, without stars."""
    found = sections(thing)
    entries = [part.name for name in names for part in found[name]]
    return {x.strip().lstrip("*") for entry in entries for x in entry.split(",")}


def arguments(function):
    return set(inspect.signature(function).parameters) - {"self", "cls"}


def test_every_argument_of_a_function_is_documented():
    for name, function in FUNCTIONS.items():
        found = documented(function, "Parameters", "Other Parameters")
        assert found == arguments(function), name


def attributes(cls):
    if dataclasses.is_dataclass(cls):
        return {x for x in vars(cls).get("__annotations__", {}) if not x.startswith("_")}
    return arguments(vars(cls)["__init__"]) if "__init__" in vars(cls) else set()


def test_a_class_documents_its_arguments_or_the_attributes_that_it_comes_with():
    for name, cls in CLASSES.items():
        parameters = documented(cls, "Parameters")
        if parameters:
            assert parameters == arguments(cls), name
        else:  # errors have a message
            assert attributes(cls) - {"message"} <= documented(cls, "Attributes"), name


# "equation (H4)", "equations (H6) to (H8)"
NAMED = re.compile(
    r"equations? \([A-Z]\d{1,2}\)(?:( to |, | and )\([A-Z]\d{1,2}\))*", re.IGNORECASE
)


def test_a_docstring_says_that_the_number_of_an_equation_is_one_and_of_what():
    """In a terminal (H4) alone means nothing; a sentence with words comes before it."""
    for name, thing in {**FUNCTIONS, **CLASSES}.items():
        text = " ".join((inspect.getdoc(thing) or "").split())
        bare = re.findall(r"\([A-Z]\d{1,2}\)", NAMED.sub("", text))
        assert not bare, (name, bare)
        alone = re.search(rf"(?:^|[.:] |-- )(?:{NAMED.pattern})(?: of [\w/.]+)?\.", text, re.I)
        assert not alone, (name, alone)
