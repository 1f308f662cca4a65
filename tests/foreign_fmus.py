"""FMUs written by hand in C against the headers of the standard: a lag of the first order, ``T·y' = u - y``.

Above `limit` its drive is switched off, which is a state event; at 3 s it is switched on again, a time event.
"""

from __future__ import annotations

import re
import sys
import zipfile
from pathlib import Path

import fmpy

from rigctl.model.fmu.export import _compiled

#: derivatives of the state; a fault takes the place of this
RATE = "(m->on * m->u - m->y) / m->T"

#: value references: 0 u, 1 y, 2 der(y), 3 T, 4 limit
_COMMON = """
#include <math.h>
#include <stdlib.h>
typedef struct { double u, y, d, T, limit, on, time; } Lag;
static Lag *made(void) {
    Lag *m = calloc(1, sizeof(Lag));
    m->T = 1.0; m->limit = 1e30; m->on = 1.0;
    return m;
}
static volatile int going = 1;
static double loop(void) { while (going) {} return 0.0; }
static double rate(Lag *m) { (void)loop; return RATE; }
static double *at(Lag *m, unsigned i) { m->d = i == 2 ? rate(m) : 0.0; return &m->u + i; }
static void events(Lag *m) {
    if (m->y >= m->limit - 1e-9) m->on = 0.0;
    if (m->time >= 3.0) m->on = 1.0;
}
"""

_TWO = """
typedef fmi2Component C;
typedef const fmi2ValueReference *V;
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
C fmi2Instantiate(fmi2String a, fmi2Type b, fmi2String c, fmi2String d, const fmi2CallbackFunctions *e,
                  fmi2Boolean f, fmi2Boolean g) { return made(); }
void fmi2FreeInstance(C m) { free(m); }
fmi2Status fmi2SetupExperiment(C m, fmi2Boolean a, fmi2Real b, fmi2Real start, fmi2Boolean c, fmi2Real d) {
    ((Lag *)m)->time = start; return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(C m) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(C m) { return fmi2OK; }
fmi2Status fmi2Terminate(C m) { return fmi2OK; }
fmi2Status fmi2GetReal(C m, V r, size_t n, fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) v[i] = *at(m, r[i]);
    return fmi2OK; }
fmi2Status fmi2SetReal(C m, V r, size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) *at(m, r[i]) = v[i];
    return fmi2OK; }
fmi2Status fmi2EnterEventMode(C m) { return fmi2OK; }
fmi2Status fmi2NewDiscreteStates(C c, fmi2EventInfo *e) {
    Lag *m = c;
    events(m);
    e->newDiscreteStatesNeeded = e->terminateSimulation = e->nominalsOfContinuousStatesChanged = 0;
    e->valuesOfContinuousStatesChanged = 0;
    e->nextEventTimeDefined = m->time < 3.0;
    e->nextEventTime = 3.0;
    return fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(C m) { return fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(C m, fmi2Boolean a, fmi2Boolean *b, fmi2Boolean *c) {
    *b = *c = 0; return fmi2OK; }
fmi2Status fmi2SetTime(C m, fmi2Real t) { ((Lag *)m)->time = t; return fmi2OK; }
fmi2Status fmi2SetContinuousStates(C m, const fmi2Real x[], size_t n) { ((Lag *)m)->y = *x; return fmi2OK; }
fmi2Status fmi2GetDerivatives(C m, fmi2Real d[], size_t n) { *d = rate(m); return fmi2OK; }
fmi2Status fmi2GetEventIndicators(C m, fmi2Real z[], size_t n) {
    *z = ((Lag *)m)->y - ((Lag *)m)->limit; return fmi2OK; }
fmi2Status fmi2GetContinuousStates(C m, fmi2Real x[], size_t n) { *x = ((Lag *)m)->y; return fmi2OK; }
fmi2Status fmi2GetNominalsOfContinuousStates(C m, fmi2Real x[], size_t n) { *x = 1.0; return fmi2OK; }
"""

_THREE = """
typedef fmi3Instance C;
typedef const fmi3ValueReference *V;
const char *fmi3GetVersion(void) { return "3.0"; }
C fmi3InstantiateModelExchange(fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d, fmi3Boolean e,
    fmi3InstanceEnvironment f, fmi3LogMessageCallback g) { return made(); }
C fmi3InstantiateCoSimulation(fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d, fmi3Boolean e,
    fmi3Boolean f, fmi3Boolean g, V h, size_t i, fmi3InstanceEnvironment j, fmi3LogMessageCallback k,
    fmi3IntermediateUpdateCallback l) { return made(); }
void fmi3FreeInstance(C m) { free(m); }
fmi3Status fmi3EnterInitializationMode(C m, fmi3Boolean a, fmi3Float64 b, fmi3Float64 start, fmi3Boolean c,
    fmi3Float64 d) { ((Lag *)m)->time = start; return fmi3OK; }
fmi3Status fmi3ExitInitializationMode(C m) { return fmi3OK; }
fmi3Status fmi3Terminate(C m) { return fmi3OK; }
fmi3Status fmi3GetFloat64(C m, V r, size_t n, fmi3Float64 v[], size_t k) {
    for (size_t i = 0; i < n; i++) v[i] = *at(m, r[i]);
    return fmi3OK; }
fmi3Status fmi3SetFloat64(C m, V r, size_t n, const fmi3Float64 v[], size_t k) {
    for (size_t i = 0; i < n; i++) *at(m, r[i]) = v[i];
    return fmi3OK; }
fmi3Status fmi3DoStep(C c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d,
    fmi3Boolean *e, fmi3Float64 *f) {
    Lag *m = c;
    m->time = t;
    /* exact for a constant input */
    m->y += rate(m) * m->T * -expm1(-h / m->T);
    *b = *d = *e = 0; *f = t + h;
    return fmi3OK; }
fmi3Status fmi3EnterEventMode(C m) { return fmi3OK; }
fmi3Status fmi3UpdateDiscreteStates(C c, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e,
    fmi3Boolean *defined, fmi3Float64 *next) {
    Lag *m = c;
    events(m);
    *a = *b = *d = *e = 0; *defined = m->time < 3.0; *next = 3.0;
    return fmi3OK; }
fmi3Status fmi3EnterContinuousTimeMode(C m) { return fmi3OK; }
fmi3Status fmi3CompletedIntegratorStep(C m, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *c) {
    *b = *c = 0; return fmi3OK; }
fmi3Status fmi3SetTime(C m, fmi3Float64 t) { ((Lag *)m)->time = t; return fmi3OK; }
fmi3Status fmi3SetContinuousStates(C m, const fmi3Float64 x[], size_t n) {
    ((Lag *)m)->y = *x; return fmi3OK; }
fmi3Status fmi3GetContinuousStateDerivatives(C m, fmi3Float64 d[], size_t n) {
    *d = rate(m); return fmi3OK; }
fmi3Status fmi3GetEventIndicators(C m, fmi3Float64 z[], size_t n) {
    *z = ((Lag *)m)->y - ((Lag *)m)->limit; return fmi3OK; }
fmi3Status fmi3GetContinuousStates(C m, fmi3Float64 x[], size_t n) { *x = ((Lag *)m)->y; return fmi3OK; }
fmi3Status fmi3GetNominalsOfContinuousStates(C m, fmi3Float64 x[], size_t n) { *x = 1.0; return fmi3OK; }
"""

_ABOUT_TWO = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="lag" guid="lag" numberOfEventIndicators="1">
<KIND modelIdentifier="lag"/>
<UnitDefinitions>UNITS</UnitDefinitions>
<ModelVariables>
<ScalarVariable name="INPUT" valueReference="0" causality="input"><Real start="0" U_UNIT/></ScalarVariable>
<ScalarVariable name="OUTPUT" valueReference="1" causality="output" initial="exact">
<Real start="0" Y_UNIT/></ScalarVariable>
<ScalarVariable name="der" valueReference="2"><Real derivative="2"/></ScalarVariable>
<ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed">
<Real start="1"/></ScalarVariable>
<ScalarVariable name="limit" valueReference="4" causality="parameter" variability="fixed">
<Real start="1e30"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2"/></Outputs><Derivatives><Unknown index="3"/></Derivatives>
<InitialUnknowns><Unknown index="3"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""

_ABOUT_THREE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="lag" instantiationToken="lag">
<KIND modelIdentifier="lag"/>
<UnitDefinitions>UNITS</UnitDefinitions>
<ModelVariables>
<Float64 name="INPUT" valueReference="0" causality="input" start="0" U_UNIT/>
<Float64 name="OUTPUT" valueReference="1" causality="output" initial="exact" start="0" Y_UNIT/>
<Float64 name="der" valueReference="2" derivative="1"/>
<Float64 name="T" valueReference="3" causality="parameter" variability="fixed" start="1"/>
<Float64 name="limit" valueReference="4" causality="parameter" variability="fixed" start="1e30"/>
<Float64 name="z" valueReference="5"/><Float64 name="time" valueReference="6" causality="independent"/>
</ModelVariables>
<ModelStructure><Output valueReference="1"/><ContinuousStateDerivative valueReference="2"/>
<InitialUnknown valueReference="2"/><EventIndicator valueReference="5"/></ModelStructure>
</fmiModelDescription>
"""


def _with_the_others(code: str, headers: Path, prefix: str) -> str:
    """A program with the functions that it needs not, all of which the standard wants to be there."""
    text = (headers / f"{prefix}FunctionTypes.h").read_text(encoding="utf-8")
    declared = re.findall(rf"typedef\s+([\w ]+\*?)\s+({prefix}\w+)TYPE\s*\((.*?)\);", text, re.DOTALL)
    missing = [
        f"{result} {name}({words.replace('fmi2Byte[]', 'fmi2Byte b[]')}) {{ return ({result})0; }}"
        for result, name, words in declared
        if f"{name}(" not in code
    ]
    header = (headers / f"{prefix}Functions.h").as_posix()
    return "\n".join([f'#include "{header}"', code, *missing, ""])


def lag_fmu(
    path: Path,
    version: str,
    kind: str,
    *,
    rate: str = RATE,
    names: tuple[str, str] = ("u", "y"),
    units: tuple[str, str] = ("", ""),
    defined: str = "<Unit name='1'/>",
    platform: str = "",
    variability: str = "fixed",
) -> Path:
    """Compile and write one.

    Parameters
    ----------
    rate: C expression of the derivative.
    names, units: of the input and of the output.
    defined: the definitions of units.
    platform: the folder of its program; by default that of this computer.
    variability: of its parameters.
    """
    two = version == "2.0"
    code = _COMMON.replace("RATE", rate) + (_TWO if two else _THREE)
    code = _with_the_others(code, Path(fmpy.__file__).parent / "c-code", f"fmi{version[0]}")
    library = "lag" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    program = _compiled({"sources/slave.c": code.encode(), "sources/equations.h": b""}, library)
    about = (_ABOUT_TWO if two else _ABOUT_THREE).replace("fixed", variability)
    parts = {"KIND": kind, "INPUT": names[0], "OUTPUT": names[1], "UNITS": defined}
    parts |= {
        key: f'unit="{unit}"' * bool(unit) for key, unit in zip(("U_UNIT", "Y_UNIT"), units, strict=True)
    }
    for key, text in parts.items():
        about = about.replace(key, text)
    folder = platform or (fmpy.platform if two else fmpy.platform_tuple)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", about)
        archive.writestr(f"binaries/{folder}/{library}", program)
    return path


#: derivatives of the motor's speed; a fault takes the place of this
ACCELERATION = "(m->k * current - m->b * speed) / m->J"

#: a motor with a direct current: value references 0 voltage, 1 speed, 2 current, 3 R, 4 k, 5 b, 6 J, 7 L
_MOTOR = """
#include <math.h>
#include <stdlib.h>
typedef struct { double voltage, speed, current, R, k, b, J, L, time; } Motor;
static Motor *made(void) {
    Motor *m = calloc(1, sizeof(Motor));
    m->R = 1.8; m->k = 0.045; m->b = 2e-4; m->J = 2e-4; m->L = 20e-3;
    return m;
}
static volatile int going = 1;
static double loop(void) { while (going) {} return 0.0; }
static double acceleration(Motor *m, double speed, double current) { (void)loop; return RATE; }
static double *at(Motor *m, unsigned i) { return &m->voltage + i; }
static void rates(Motor *m, const double *x, double *d) {
    d[0] = acceleration(m, x[0], x[1]);
    d[1] = (m->voltage - m->R * x[1] - m->k * x[0]) / m->L;
}
static void advance(Motor *m, double h) {
    double x[2] = {m->speed, m->current}, a[2], b[2], c[2], d[2], y[2];
    rates(m, x, a);
    for (int i = 0; i < 2; i++) y[i] = x[i] + 0.5 * h * a[i];
    rates(m, y, b);
    for (int i = 0; i < 2; i++) y[i] = x[i] + 0.5 * h * b[i];
    rates(m, y, c);
    for (int i = 0; i < 2; i++) y[i] = x[i] + h * c[i];
    rates(m, y, d);
    m->speed += h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0]);
    m->current += h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1]);
    m->time += h;
}
static void go(Motor *m, double t, double h) {
    int n = (int)ceil(h / 0.5e-3);
    m->time = t;
    for (int i = 0; i < n; i++) advance(m, h / n);
}
"""

_STEP_TWO = """
fmi2Status fmi2DoStep(C m, fmi2Real t, fmi2Real h, fmi2Boolean a) { go(m, t, h); return fmi2OK; }
"""
_STEP_THREE = """
fmi3Status fmi3DoStep(C m, fmi3Float64 t, fmi3Float64 h, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d,
    fmi3Boolean *e, fmi3Float64 *f) { go(m, t, h); *b = *d = *e = 0; *f = t + h; return fmi3OK; }
"""
_MOTOR_VARIABLES = (
    ("voltage", "input", "0", "V"),
    ("speed", "output", "0", "rad/s"),
    ("current", "output", "0", "A"),
    ("R", "parameter", "1.8", "Ohm"),
    ("k", "parameter", "0.045", "N.m/A"),
    ("b", "parameter", "2e-4", "N.m.s/rad"),
    ("J", "parameter", "2e-4", "kg.m2"),
    ("L", "parameter", "20e-3", "H"),
)


def _motor_description(two: bool, variability: str) -> str:
    lines = []
    for reference, (name, causality, start, unit) in enumerate(_MOTOR_VARIABLES):
        about = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        about += {"output": ' initial="exact"', "parameter": f' variability="{variability}"'}.get(
            causality, ""
        )
        real = f'start="{start}" unit="{unit}"'
        lines.append(
            f"<ScalarVariable {about}><Real {real}/></ScalarVariable>"
            if two
            else f"<Float64 {about} {real}/>"
        )
    if two:
        head = 'fmiVersion="2.0" modelName="motor" guid="motor"'
        structure = '<Outputs><Unknown index="2"/><Unknown index="3"/></Outputs>'
    else:
        head = 'fmiVersion="3.0" modelName="motor" instantiationToken="motor"'
        lines.append('<Float64 name="time" valueReference="8" causality="independent"/>')
        structure = '<Output valueReference="1"/><Output valueReference="2"/>'
    units = "".join(f'<Unit name="{unit}"/>' for unit in sorted({one[3] for one in _MOTOR_VARIABLES}))
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription {head}>'
        f'<CoSimulation modelIdentifier="motor" canHandleVariableCommunicationStepSize="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def _for_motor(shared: str) -> str:
    """The functions that any kind of FMU has, without those of model exchange and of the lag's steps."""
    ends = {"fmi2Status fmi2EnterEventMode", "fmi3Status fmi3DoStep"}
    end = min(shared.index(one) for one in ends if one in shared)
    return shared[:end].replace("Lag", "Motor")


def motor_fmu(
    path: Path, version: str = "2.0", *, acceleration: str = ACCELERATION, variability: str = "fixed"
) -> Path:
    """Compile and write the co-simulation of a motor.

    Parameters
    ----------
    acceleration: C expression.
    variability: of its parameters: "tunable" ones can change during a simulation.
    """
    two = version == "2.0"
    shared, step = (_TWO, _STEP_TWO) if two else (_THREE, _STEP_THREE)
    code = _MOTOR.replace("RATE", acceleration) + _for_motor(shared) + step
    code = _with_the_others(code, Path(fmpy.__file__).parent / "c-code", f"fmi{version[0]}")
    library = "motor" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    program = _compiled({"sources/slave.c": code.encode(), "sources/equations.h": b""}, library)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", _motor_description(two, variability))
        archive.writestr(f"binaries/{fmpy.platform if two else fmpy.platform_tuple}/{library}", program)
    return path
