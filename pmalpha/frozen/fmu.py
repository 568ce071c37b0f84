"""Frozen models as FMUs: FMI 2.0 and 3.0, for co-simulation, with sources and a binary."""

from __future__ import annotations

import platform
import re
import sys
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Any, BinaryIO, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

import pmalpha._core as _core

from .._checks import listing
from ..files import package_version
from ..problem.subdomain import Subdomain
from .model import HEADER, Keys, Output, Ports, c_library

VERSIONS = ("2.0", "3.0")
# A larger model is no array of the sources, which compilers take minutes for: they read the file.
MOST_IN_SOURCES = 4_000_000
# Values in a line of model.c.
IN_LINE = 5
# What each version says of the binary: (system, processor) by sys.platform and platform.machine.
PLATFORMS = {
    "2.0": {
        ("linux", "x86_64"): "linux64",
        ("darwin", "x86_64"): "darwin64",
        ("win32", "AMD64"): "win64",
    },
    "3.0": {
        ("linux", "x86_64"): "x86_64-linux",
        ("linux", "aarch64"): "aarch64-linux",
        ("darwin", "x86_64"): "x86_64-darwin",
        ("darwin", "arm64"): "aarch64-darwin",
        ("win32", "AMD64"): "x86_64-windows",
    },
}
SUFFIXES = {"darwin": ".dylib", "win32": ".dll"}
# Every source begins with this header.
DIGITS = """/* digits.h - before all else: a fused multiply-add would round otherwise. */
#ifndef PMALPHA_DIGITS_H
#define PMALPHA_DIGITS_H
#pragma STDC FP_CONTRACT OFF
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#endif
#endif
"""
# Four variables for each input, as csrc/fmu/fmu.h has them.
EACH_INPUT = 4
COMMAND = {"u": "displacement", "v": "velocity", "a": "acceleration"}
OF_INPUT = {
    "specimen": "force of the specimen at its command, on {}. Exact with a model that is evaluated "
    "between two steps; hardware behind a converter answers the command before, one sample late, "
    "which puts energy in: compensate the delay, or use a loop in C",
    "force": "external force on {}, added to its loads",
    "velocity": "velocity of row {} of the constraints, added to the prescribed one",
}
OF_OUTPUT = {
    "u": "displacement of {}",
    "v": "velocity of {}",
    "a": "acceleration of {}",
    "multiplier": "multiplier of row {} of the constraints",
    "deformation": "deformation of spring {}",
    "spring force": "force of spring {}",
}


class Steps(NamedTuple):
    """The time at which the model begins, and the length of its fine steps."""

    start: float
    fine: float

    @property
    def description(self) -> str:
        return (
            f"A frozen coupler of pmalpha. It begins at t = {float(self.start)!r}; communication "
            f"steps are multiples of its fine step, {float(self.fine)!r}. An input that is set "
            "acts ahead of the present, by a substep of its subdomain."
        )

    @property
    def experiment(self) -> str:
        return f"<DefaultExperiment{_attributes(startTime=self.start, stepSize=self.fine)}/>"


class Variable(NamedTuple):
    """A variable of an FMU."""

    name: str
    reference: int
    causality: str
    start: float | None
    description: str
    unit: str | None = None


def variables_of(
    ports: Ports, starts: list[float], keys: Keys, units: Mapping[str, str] | None = None
) -> list[Variable]:
    """Inputs, the commands of specimens, and outputs, with their units by name."""
    made = []
    for i, (x, start) in enumerate(zip(ports.inputs, starts)):
        where = str(x.dof) if x.kind == "velocity" else _dof(keys[x.subdomain], x.dof)
        text = OF_INPUT[x.kind].format(where)
        made.append(Variable(x.name, EACH_INPUT * i, "input", start, text))
        for k, (part, what) in enumerate(COMMAND.items()):
            if x.kind == "specimen":
                text = f"{what} of the next command of {where}"
                made.append(
                    Variable(f"{x.name}.{part}", EACH_INPUT * i + 1 + k, "output", None, text)
                )
    first = EACH_INPUT * len(ports.inputs)
    for j, y in enumerate(ports.outputs):
        text = OF_OUTPUT[y.what].format(_place(y, keys))
        made.append(Variable(y.name, first + j, "output", None, text))
    _check_names(made)
    units = units or {}
    if unknown := units.keys() - {x.name for x in made}:
        got = listing([repr(x) for x in sorted(map(str, unknown))])
        raise ValueError(f"units must have names of inputs and outputs, got {got}")
    _check_characters([x.name for x in made], "names of inputs and outputs")
    _check_characters(units.values(), "units")
    return [x._replace(unit=units.get(x.name)) for x in made]


def _check_characters(words: Iterable[Any], what: str) -> None:
    """ValueError for words that XML cannot have, such as those with control characters."""
    for word in words:
        if not isinstance(word, str) or not word.isprintable():
            raise ValueError(f"{what} must be words that can be printed, got {word!r}")


def _dof(key: tuple[str, Subdomain], dof: int) -> str:
    name, s = key
    label = "" if s.dof_names is None else f" ({s.dof_names[dof]})"
    return f"dof {dof}{label} of {name}"


def _place(y: Output, keys: Keys) -> str:
    if y.what in ("u", "v", "a"):
        return _dof(keys[y.subdomain], y.number)
    return str(y.number) if y.what == "multiplier" else f"{y.number} of {keys[y.subdomain][0]}"


def _check_names(variables: list[Variable]) -> None:
    """ValueError for the name of the independent variable, and for that of a command."""
    names = [x.name for x in variables]
    if "time" in names:
        raise ValueError(
            "inputs and outputs of an FMU must have other names than 'time', which is that of its "
            "independent variable"
        )
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                "inputs and outputs of an FMU must have other names than the commands of its "
                f"specimens, got {name!r}"
            )


def write(
    file: BinaryIO,
    identifier: str,
    content: bytearray,
    variables: list[Variable],
    *,
    time: int,
    start: float,
    fine: float,
    fmi: str,
    license: str | None,
) -> None:
    """Write an FMU with the bytes of a model, of fine steps of length `fine` from `start` on.

    time: the reference of the independent variable.
    """
    token = token_of(content)
    sources = _sources(fmi, content)
    listed = [name for name in sources if name.endswith(".c")]
    describe = {"2.0": _description_2, "3.0": _description_3}[fmi]
    parts: dict[str, Any] = {
        "modelDescription.xml": describe(
            identifier, token, variables, Steps(start, fine), listed, time=time
        )
    }
    parts["resources/model.pma"] = bytes(content)
    parts["documentation/licenses/pmalpha.txt"] = (c_library() / "LICENSE").read_bytes()
    if license is not None:
        parts["documentation/licenses/license.txt"] = license
    parts |= {f"sources/{name}": text for name, text in sources.items()}
    if fmi == "3.0":
        parts["sources/buildDescription.xml"] = _build_description(identifier, listed)
    folder = PLATFORMS[fmi].get((sys.platform, platform.machine()))
    if folder is not None:
        suffix = SUFFIXES.get(sys.platform, ".so")
        binary = c_library() / f"fmu{fmi[0]}{suffix}"
        parts[f"binaries/{folder}/{identifier}{suffix}"] = binary.read_bytes()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # equal couplers give equal files
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries") else 0o644) << 16
            archive.writestr(info, data)


def identifier_of(stem: str) -> str:
    """A name of C for a file of any name."""
    name = re.sub(r"\W", "_", stem, flags=re.ASCII)
    return name if name and not name[0].isdigit() else f"m{name}"


def token_of(content: bytearray) -> str:
    """The check sum and the size of a model, by which the FMU knows it."""
    return f"{{{_core.check_sum(memoryview(content)[HEADER:]):016x}-{len(content)}}}"


# ---- sources -------------------------------------------------------------------------------------


def _sources(fmi: str, content: bytearray) -> dict[str, str]:
    """All sources by their path, with the model unless that is large."""
    made = {"digits.h": DIGITS}
    other = {"fmu/fmu2.c", "fmu/fmu3.c"} - {f"fmu/fmu{fmi[0]}.c"}
    in_sources = len(content) <= MOST_IN_SOURCES
    with zipfile.ZipFile(c_library() / "sources.zip") as archive:
        for name in sorted(archive.namelist()):
            if name in other or (in_sources and name == "fmu/resource.c"):
                continue
            text = archive.read(name).decode()
            depth = len(PurePosixPath(name).parts) - 1
            first = f'#include "{"../" * depth}digits.h"\n' if name.endswith(".c") else ""
            made[name] = first + text
    if in_sources:
        made["model.c"] = '#include "digits.h"\n' + _model(content)
    return made


def _model(content: bytearray) -> str:
    words = [f"0x{x:x}u" for x in np.frombuffer(content, np.uint64).tolist()]
    lines = [", ".join(words[i : i + IN_LINE]) for i in range(0, len(words), IN_LINE)]
    body = ",\n    ".join(lines)
    return f"""/* model.c - the frozen model, as 64-bit words. */
#include "fmu/fmu.h"

static const uint64_t WORDS[] = {{
    {body}}};

const void *fmu_bytes(const char *resources, size_t *size, void **owned)
{{
    (void)resources;
    *owned = NULL;
    *size = sizeof WORDS;
    return WORDS;
}}
"""


# ---- descriptions --------------------------------------------------------------------------------


def _attributes(**values: Any) -> str:
    words = {True: "true", False: "false"}
    shown = {k: words[v] if isinstance(v, bool) else v for k, v in values.items() if v is not None}
    return "".join(f" {k}={quoteattr(_number(v))}" for k, v in shown.items())


def _number(x: Any) -> str:
    return repr(float(x)) if isinstance(x, float) else str(x)


def time_of(ports: Ports) -> int:
    """The reference of the independent variable."""
    return EACH_INPUT * len(ports.inputs) + len(ports.outputs)


def _units(variables: list[Variable]) -> list[str]:
    """Their definitions, if there are any: names alone, which masters show and do not convert."""
    names = sorted({x.unit for x in variables if x.unit is not None})
    if not names:
        return []
    units = "".join(f"<Unit{_attributes(name=name)}/>" for name in names)
    return [f"<UnitDefinitions>{units}</UnitDefinitions>"]


def _head(version: str, **attributes: Any) -> str:
    tool = f"pmalpha {package_version()}"
    shown = _attributes(fmiVersion=version, generationTool=tool, **attributes)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription{shown}>\n'


def _description_2(
    identifier: str,
    token: str,
    variables: list[Variable],
    steps: Steps,
    sources: list[str],
    *,
    time: int,
) -> str:
    head = _head(
        "2.0",
        modelName=identifier,
        guid=token,
        description=steps.description,
        variableNamingConvention="structured",
        numberOfEventIndicators=0,
    )
    flags = _attributes(
        modelIdentifier=identifier,
        canHandleVariableCommunicationStepSize=False,
        canInterpolateInputs=True,
        canGetAndSetFMUstate=True,
        canSerializeFMUstate=True,
        canBeInstantiatedOnlyOncePerProcess=False,
        canNotUseMemoryManagementFunctions=True,
        needsExecutionTool=False,
        providesDirectionalDerivative=False,
    )
    files = "".join(f"<File{_attributes(name=name)}/>" for name in sources)
    lines = [f"<CoSimulation{flags}><SourceFiles>{files}</SourceFiles></CoSimulation>"]
    lines += _units(variables)
    lines.append(steps.experiment)
    lines.append("<ModelVariables>")
    for x in variables:
        initial = "calculated" if x.causality == "output" else None
        shown = _attributes(
            name=x.name,
            valueReference=x.reference,
            description=x.description,
            causality=x.causality,
            variability="continuous",
            initial=initial,
        )
        real = _attributes(unit=x.unit, start=x.start)
        lines.append(f"<ScalarVariable{shown}><Real{real}/></ScalarVariable>")
    lines.append("</ModelVariables>")
    numbers = [i for i, x in enumerate(variables, 1) if x.causality == "output"]
    # between steps no output depends on inputs; at the start they depend on all of them
    outputs = "".join(f'<Unknown index="{i}" dependencies=""/>' for i in numbers)
    initial = "".join(f'<Unknown index="{i}"/>' for i in numbers)
    structure = f"<Outputs>{outputs}</Outputs><InitialUnknowns>{initial}</InitialUnknowns>"
    lines.append(f"<ModelStructure>{structure if numbers else ''}</ModelStructure>")
    return head + "\n".join(lines) + "\n</fmiModelDescription>\n"


def _description_3(
    identifier: str,
    token: str,
    variables: list[Variable],
    steps: Steps,
    sources: list[str],
    *,
    time: int,
) -> str:
    head = _head(
        "3.0",
        modelName=identifier,
        instantiationToken=token,
        description=steps.description,
        variableNamingConvention="structured",
    )
    flags = _attributes(
        modelIdentifier=identifier,
        canHandleVariableCommunicationStepSize=False,
        fixedInternalStepSize=steps.fine,
        canGetAndSetFMUState=True,
        canSerializeFMUState=True,
        canBeInstantiatedOnlyOncePerProcess=False,
        needsExecutionTool=False,
    )
    lines = [f"<CoSimulation{flags}/>", *_units(variables)]
    lines.append(steps.experiment)
    independent = _attributes(
        name="time", valueReference=time, causality="independent", variability="continuous"
    )
    lines += ["<ModelVariables>", f"<Float64{independent}/>"]
    for x in variables:
        initial = "calculated" if x.causality == "output" else None
        shown = _attributes(
            name=x.name,
            valueReference=x.reference,
            description=x.description,
            causality=x.causality,
            variability="continuous",
            initial=initial,
            unit=x.unit,
            start=x.start,
        )
        lines.append(f"<Float64{shown}/>")
    lines.append("</ModelVariables>")
    references = [x.reference for x in variables if x.causality == "output"]
    unknown = "".join(
        f'<{kind} valueReference="{r}"{dependencies}/>'
        # between steps no output depends on inputs; at the start they depend on all of them
        for kind, dependencies in (("Output", ' dependencies=""'), ("InitialUnknown", ""))
        for r in references
    )
    lines.append(f"<ModelStructure>{unknown}</ModelStructure>")
    return head + "\n".join(lines) + "\n</fmiModelDescription>\n"


def _build_description(identifier: str, sources: list[str]) -> str:
    files = "\n".join(f"<SourceFile{_attributes(name=name)}/>" for name in sources)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
<BuildConfiguration{_attributes(modelIdentifier=identifier)}>
<SourceFileSet language="C11">
{files}
</SourceFileSet>
<Library name="m"/>
</BuildConfiguration>
</fmiBuildDescription>
"""
