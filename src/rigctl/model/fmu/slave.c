/* A model of rigctl as a slave of FMI 2.0 for co-simulation (https://fmi-standard.org).
 *
 * equations.h is written for each model: the numbers of states, inputs, parameters and outputs, their values at the
 * start, and the straight-line code of  dy/dt = f(y, u, q)  with its Jacobian, of the outputs  z = g(y, u, q), and of
 * the delays of inputs.
 *
 * The integrator is RODAS (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., IV.7): a
 * Rosenbrock method of order 4(3), stiffly accurate and L-stable, with the exact Jacobian. Inputs are constant between
 * two communication points; one that is delayed acts on time inside a step.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "equations.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* What the standard declares (fmi2TypesPlatform.h, fmi2FunctionTypes.h), as far as a slave needs it. */
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

#define PARAMETERS_AT 1000u
#define OUTPUTS_AT 100000u
#define STATES_AT 200000u
/* switches of one input that may wait for their delay */
#define WAITING 64
#define ROOM(n) ((n) > 0 ? (n) : 1)

typedef struct {
    double time;
    double y[ROOM(STATES)];
    double commanded[ROOM(INPUTS)]; /* as they were set */
    double known[ROOM(INPUTS)];     /* as they were at the last communication point */
    double u[ROOM(INPUTS)];         /* as they act */
    double q[ROOM(PARAMETERS)];
    double tolerance;
    double h; /* s, of the next step */
    int running;
    int waiting[ROOM(INPUTS)];
    double when[ROOM(INPUTS)][WAITING];
    double what[ROOM(INPUTS)][WAITING];
} State;

typedef struct {
    State now;
    fmi2CallbackFunctions callbacks;
    char *name;
} Slave;

static fmi2Status fail(Slave *slave, const char *text)
{
    if (slave->callbacks.logger != NULL)
        slave->callbacks.logger(slave->callbacks.componentEnvironment, slave->name, fmi2Error, "error", "%s", text);
    return fmi2Error;
}

static void begin(State *s)
{
    memset(s, 0, sizeof *s);
    memcpy(s->y, START_STATES, sizeof s->y);
    memcpy(s->commanded, START_INPUTS, sizeof s->commanded);
    memcpy(s->q, START_PARAMETERS, sizeof s->q);
    memcpy(s->known, s->commanded, sizeof s->known);
    memcpy(s->u, s->commanded, sizeof s->u);
    s->tolerance = 1e-8;
    s->h = 1e-6;
}

/* --- RODAS ------------------------------------------------------------------------------------------------ */

#define STAGES 6
static const double GAMMA = 0.25;
static const double A[STAGES][STAGES] = {
    {0},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950},
    {0},
};
static const double C[STAGES][STAGES] = {
    {0},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054},
};

/* LU factors with partial pivoting, in place; 0 where there are none */
static int factorise(double m[ROOM(STATES)][ROOM(STATES)], int *pivot)
{
    for (int k = 0; k < STATES; k++) {
        int best = k;
        for (int i = k + 1; i < STATES; i++)
            if (fabs(m[i][k]) > fabs(m[best][k])) best = i;
        pivot[k] = best;
        if (!(fabs(m[best][k]) > 0.0) || !isfinite(m[best][k])) return 0;
        if (best != k)
            for (int j = 0; j < STATES; j++) {
                double kept = m[k][j];
                m[k][j] = m[best][j];
                m[best][j] = kept;
            }
        for (int i = k + 1; i < STATES; i++) {
            double factor = m[i][k] /= m[k][k];
            if (factor != 0.0)
                for (int j = k + 1; j < STATES; j++) m[i][j] -= factor * m[k][j];
        }
    }
    return 1;
}

static void solve(double m[ROOM(STATES)][ROOM(STATES)], const int *pivot, double *x)
{
    for (int k = 0; k < STATES; k++) { /* rows were exchanged whole: all exchanges first */
        double kept = x[k];
        x[k] = x[pivot[k]];
        x[pivot[k]] = kept;
    }
    for (int k = 0; k < STATES; k++)
        for (int i = k + 1; i < STATES; i++) x[i] -= m[i][k] * x[k];
    for (int k = STATES - 1; k >= 0; k--) {
        for (int j = k + 1; j < STATES; j++) x[k] -= m[k][j] * x[j];
        x[k] /= m[k][k];
    }
}

/* One step of h from s->y: the new state, and its error in units of the tolerance; infinite where it failed */
static double attempt(const State *s, double h, double *result)
{
    double value[ROOM(STATES)], jacobian[ROOM(STATES * STATES)], m[ROOM(STATES)][ROOM(STATES)];
    double k[STAGES][ROOM(STATES)], at[ROOM(STATES)];
    int pivot[ROOM(STATES)];
    memset(jacobian, 0, sizeof jacobian);
    eq_rhs_jacobian(s->y, s->u, s->q, value, jacobian);
    for (int i = 0; i < STATES; i++)
        for (int j = 0; j < STATES; j++) m[i][j] = (i == j ? 1.0 / (h * GAMMA) : 0.0) - jacobian[i * STATES + j];
    if (!factorise(m, pivot)) return INFINITY;
    memcpy(at, s->y, sizeof at);
    for (int stage = 0; stage < STAGES; stage++) {
        if (stage > 0) {
            if (stage < STAGES - 1) {
                memcpy(at, s->y, sizeof at);
                for (int j = 0; j < stage; j++)
                    for (int i = 0; i < STATES; i++) at[i] += A[stage][j] * k[j][i];
            } else {
                for (int i = 0; i < STATES; i++) at[i] += k[stage - 1][i]; /* the embedded result of order 3 */
            }
            eq_rhs(at, s->u, s->q, value);
        }
        for (int i = 0; i < STATES; i++) {
            k[stage][i] = value[i];
            for (int j = 0; j < stage; j++) k[stage][i] += C[stage][j] / h * k[j][i];
        }
        solve(m, pivot, k[stage]);
    }
    double worst = 0.0;
    for (int i = 0; i < STATES; i++) {
        result[i] = at[i] + k[STAGES - 1][i];
        double size = fmax(fabs(s->y[i]), fabs(result[i]));
        double error = fabs(k[STAGES - 1][i]) / (s->tolerance * (size * RELATIVE + SCALES[i]));
        if (!isfinite(result[i]) || !isfinite(error)) return INFINITY;
        worst = fmax(worst, error);
    }
    return worst;
}

/* Integrate to `end` with constant inputs; 0 where that cannot be done */
static int advance(State *s, double end)
{
    double result[ROOM(STATES)];
    if (STATES == 0) s->time = end;
    while (s->time < end) {
        double left = end - s->time, h = s->h < left ? s->h : left;
        if (h > 0.5 * left && h < left) h = 0.5 * left; /* two equal steps instead of a long and a tiny one */
        double error = attempt(s, h, result);
        double factor = error > 0.0 ? 0.9 * pow(error, -0.25) : 6.0;
        factor = isfinite(error) ? fmin(fmax(factor, 0.2), 6.0) : 0.1;
        if (error <= 1.0) {
            memcpy(s->y, result, sizeof s->y);
            s->time = h >= left ? end : s->time + h;
            if (h >= s->h || factor < 1.0) s->h = h * factor;
        } else {
            s->h = h * fmin(factor, 0.9);
            if (s->h <= 1e-15 * fmax(1.0, fabs(s->time))) return 0;
        }
    }
    return 1;
}

/* An input was set: it acts now, or when its delay is over. A later command that acts earlier cancels the waiting. */
static int command(State *s)
{
    double delay[ROOM(INPUTS)];
    memset(delay, 0, sizeof delay);
    eq_input_delays(s->y, s->known, s->commanded, s->q, delay);
    for (int i = 0; i < INPUTS; i++) {
        if (s->commanded[i] == s->known[i]) continue;
        s->h = 1e-6; /* what follows is another course */
        double acts = s->time + fmax(delay[i], 0.0);
        while (s->waiting[i] > 0 && s->when[i][s->waiting[i] - 1] >= acts) s->waiting[i]--;
        if (acts <= s->time) {
            s->u[i] = s->commanded[i];
        } else {
            if (s->waiting[i] == WAITING) return 0;
            s->when[i][s->waiting[i]] = acts;
            s->what[i][s->waiting[i]++] = s->commanded[i];
        }
        s->known[i] = s->commanded[i];
    }
    return 1;
}

static int step_to(State *s, double end)
{
    if (!command(s)) return 0;
    for (;;) {
        double next = end;
        for (int i = 0; i < INPUTS; i++)
            if (s->waiting[i] > 0 && s->when[i][0] < next) next = s->when[i][0];
        if (!advance(s, next)) return 0;
        int switched = 0;
        for (int i = 0; i < INPUTS; i++)
            while (s->waiting[i] > 0 && s->when[i][0] <= s->time) {
                s->u[i] = s->what[i][0];
                s->waiting[i]--;
                memmove(s->when[i], s->when[i] + 1, sizeof(double) * (size_t)s->waiting[i]);
                memmove(s->what[i], s->what[i] + 1, sizeof(double) * (size_t)s->waiting[i]);
                s->h = 1e-6;
                switched = 1;
            }
        if (!switched && s->time >= end) return 1;
    }
}

/* --- FMI 2.0 ---------------------------------------------------------------------------------------------- */

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                     fmi2Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, GUID) != 0 || name == NULL) return NULL;
    Slave *slave = calloc(1, sizeof *slave);
    if (slave == NULL) return NULL;
    slave->name = malloc(strlen(name) + 1);
    if (slave->name == NULL) {
        free(slave);
        return NULL;
    }
    strcpy(slave->name, name);
    if (callbacks != NULL) slave->callbacks = *callbacks;
    begin(&slave->now);
    return slave;
}

EXPORT void fmi2FreeInstance(fmi2Component c)
{
    Slave *slave = c;
    if (slave == NULL) return;
    free(slave->name);
    free(slave);
}

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean stopped, fmi2Real stop)
{
    (void)stopped, (void)stop;
    State *s = &((Slave *)c)->now;
    if (defined && tolerance > 0.0) s->tolerance = fmin(fmax(tolerance, 1e-12), 1e-3);
    s->time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    State *s = &((Slave *)c)->now;
    memcpy(s->known, s->commanded, sizeof s->known); /* what is commanded at the start acts from the start */
    memcpy(s->u, s->commanded, sizeof s->u);
    s->running = 1;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{
    ((Slave *)c)->now.running = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    begin(&((Slave *)c)->now);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[])
{
    Slave *slave = c;
    State *s = &slave->now;
    double outputs[ROOM(OUTPUTS)], acting[ROOM(INPUTS)];
    int known = 0;
    for (size_t i = 0; i < n; i++) {
        if (r[i] < INPUTS) {
            value[i] = s->commanded[r[i]];
        } else if (r[i] >= PARAMETERS_AT && r[i] < PARAMETERS_AT + PARAMETERS) {
            value[i] = s->q[r[i] - PARAMETERS_AT];
        } else if (r[i] >= OUTPUTS_AT && r[i] < OUTPUTS_AT + OUTPUTS) {
            if (!known) {
                memcpy(acting, s->running ? s->u : s->commanded, sizeof acting);
                eq_outputs(s->y, acting, s->q, outputs);
            }
            known = 1;
            value[i] = outputs[r[i] - OUTPUTS_AT];
        } else if (r[i] >= STATES_AT && r[i] < STATES_AT + STATES) {
            value[i] = s->y[r[i] - STATES_AT];
        } else {
            return fail(slave, "there is no such value reference");
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[])
{
    Slave *slave = c;
    State *s = &slave->now;
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(value[i])) return fail(slave, "a value is not finite");
        if (r[i] < INPUTS) {
            s->commanded[r[i]] = value[i];
        } else if (s->running) {
            return fail(slave, "parameters and states are set before the simulation runs");
        } else if (r[i] >= PARAMETERS_AT && r[i] < PARAMETERS_AT + PARAMETERS) {
            s->q[r[i] - PARAMETERS_AT] = value[i];
        } else if (r[i] >= STATES_AT && r[i] < STATES_AT + STATES) {
            s->y[r[i] - STATES_AT] = value[i];
        } else {
            return fail(slave, "there is nothing to set at this value reference");
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real step, fmi2Boolean no_going_back)
{
    (void)no_going_back;
    Slave *slave = c;
    State *s = &slave->now;
    if (!(step > 0.0) || fabs(at - s->time) > 1e-9 * fmax(1.0, fabs(at)))
        return fail(slave, "a step has to be longer than zero and to begin where the last one ended");
    s->time = at;
    if (!step_to(s, at + step)) {
        char text[160];
        snprintf(text, sizeof text, "the equations cannot be integrated at %.9g s", s->time);
        return fail(slave, text);
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    if (*kept == NULL) *kept = malloc(sizeof(State));
    if (*kept == NULL) return fail(c, "out of memory");
    memcpy(*kept, &((Slave *)c)->now, sizeof(State));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate kept)
{
    if (kept == NULL) return fail(c, "there is no state");
    memcpy(&((Slave *)c)->now, kept, sizeof(State));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    (void)c;
    free(*kept);
    *kept = NULL;
    return fmi2OK;
}

/* What the standard asks every slave to have, and this one has nothing to say to. */
#define NOTHING_OF(name, ...)                                \
    EXPORT fmi2Status name(fmi2Component c, __VA_ARGS__)     \
    {                                                        \
        return n == 0 ? fmi2OK : fail(c, #name ": there are real numbers only"); \
    }
NOTHING_OF(fmi2GetInteger, const fmi2ValueReference *r, size_t n, fmi2Integer *value)
NOTHING_OF(fmi2GetBoolean, const fmi2ValueReference *r, size_t n, fmi2Boolean *value)
NOTHING_OF(fmi2GetString, const fmi2ValueReference *r, size_t n, fmi2String *value)
NOTHING_OF(fmi2SetInteger, const fmi2ValueReference *r, size_t n, const fmi2Integer *value)
NOTHING_OF(fmi2SetBoolean, const fmi2ValueReference *r, size_t n, const fmi2Boolean *value)
NOTHING_OF(fmi2SetString, const fmi2ValueReference *r, size_t n, const fmi2String *value)
NOTHING_OF(fmi2SetRealInputDerivatives, const fmi2ValueReference *r, size_t n, const fmi2Integer *o,
           const fmi2Real *value)
NOTHING_OF(fmi2GetRealOutputDerivatives, const fmi2ValueReference *r, size_t n, const fmi2Integer *o,
           fmi2Real *value)
#define CANNOT(name, ...)                                 \
    EXPORT fmi2Status name(fmi2Component c, __VA_ARGS__)  \
    {                                                     \
        return fail(c, #name " is not provided");         \
    }
CANNOT(fmi2SerializedFMUstateSize, fmi2FMUstate kept, size_t *size)
CANNOT(fmi2SerializeFMUstate, fmi2FMUstate kept, fmi2Byte *bytes, size_t size)
CANNOT(fmi2DeSerializeFMUstate, const fmi2Byte *bytes, size_t size, fmi2FMUstate *kept)
CANNOT(fmi2GetDirectionalDerivative, const fmi2ValueReference *z, size_t nz, const fmi2ValueReference *v,
       size_t nv, const fmi2Real *dv, fmi2Real *dz)
CANNOT(fmi2GetStatus, fmi2StatusKind kind, fmi2Status *value)
CANNOT(fmi2GetIntegerStatus, fmi2StatusKind kind, fmi2Integer *value)
CANNOT(fmi2GetBooleanStatus, fmi2StatusKind kind, fmi2Boolean *value)
CANNOT(fmi2GetStringStatus, fmi2StatusKind kind, fmi2String *value)

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fail(c, "there is no such status");
    *value = ((Slave *)c)->now.time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { return fail(c, "a step is over when it returns"); }
