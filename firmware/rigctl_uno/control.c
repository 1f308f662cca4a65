/* A closed loop from an input to the PWM, at a fixed period of timer 2, independent of the load of the program.
 *
 * The timer's interrupt lets the others in while it computes, so that no character and no reading is lost. How long
 * that takes depends on them; so the output is set by a second interrupt, always at the same time after the tick.
 * Whatever switches outputs off ends the loop first (`control_halt`), and nothing that was computed is set then. */
#include <avr/interrupt.h>
#include <avr/pgmspace.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <util/atomic.h>

#include "board.h"
#include "pid.h"

#define TICK_COUNTS 250 /* of 4 us each: a tick is a millisecond */
#define OUTPUT_COUNT 240 /* 0.96 ms after the tick: an update takes 0.3 to 0.75 ms */
#define COUNT_US 4
#define BINS 32
#define JITTER_BIN 2 /* counts of 4 us */
#define DELAY_BIN 10

typedef struct {
    float calibration[4];             /* reading = c0 + c1*n + c2*n^2 + c3*n^3 of the converter's counts n */
    float reading_low, reading_high;  /* outside, the reading is invalid and the output is held */
    float zero, full;                 /* the values of the PWM's 0 and 1023 */
    float to, ramp;                   /* set-point; its rate from the first reading, per s */
    float ahead;                      /* feed-forward */
    pid_settings_t pid;
} settings_t;

/* in the order of `settings_t` */
static const char NAMES[][5] PROGMEM = {"C0", "C1", "C2", "C3", "RLO", "RHI", "ZERO", "FULL", "TO",  "RAMP",
                                        "FF", "KP", "KI", "KD", "TF",  "TT",  "LOW",  "HIGH", "RATE"};
#define COUNT (sizeof NAMES / sizeof NAMES[0])
#define ALL ((1UL << COUNT) - 1)
enum { TO = 8, RAMP = 9, AHEAD = 10, TRACKING = 15, RATE = 18 };
_Static_assert(sizeof(settings_t) == COUNT * sizeof(float), "a name for each setting");

typedef struct {
    uint32_t bins[BINS];
    uint16_t largest; /* counts of 4 us */
} spread_t;

static settings_t settings;
static uint32_t given; /* a bit for each setting received from the host */
static uint8_t channel, degree;
static uint16_t period; /* ms */
static bool bumpless, clamping;

static volatile bool running;
static volatile bool busy; /* an update is being computed */
static volatile uint16_t to_go, elapsed; /* ms until the next update is due; since the last one */
static volatile uint8_t ago;             /* ms since the newest update was due */
static volatile uint16_t computed; /* counts for the output */
static pid_state_t pid;
static float first, setpoint, scale;
static uint32_t ramped; /* ms since the first reading */
static uint32_t updates, late, missed, saturated;
static spread_t jitter, delay;
static uint16_t last_delay;

static void count(spread_t *spread, uint16_t value, uint8_t width) {
    uint16_t bin = value / width;
    spread->bins[bin < BINS ? bin : BINS - 1]++;
    if (value > spread->largest)
        spread->largest = value;
}

/* Only in interrupts, or with them off: 4 us counts since the newest update was due. */
static uint16_t since_due(void) {
    uint8_t now = TCNT2;
    uint16_t ms = ago;
    if ((TIFR2 & _BV(OCF2A)) && now < TICK_COUNTS - 1) /* the tick is over, its interrupt has to wait */
        ms++;
    return ms * TICK_COUNTS + now;
}

static float read_input(void) {
    float counts = input(channel), value = settings.calibration[degree];
    for (uint8_t power = degree; power--;)
        value = value * counts + settings.calibration[power];
    return value;
}

static void move_setpoint(float reading, uint16_t span) {
    float to, ramp;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        to = settings.to;
        ramp = settings.ramp;
    }
    if (!pid.begun) {
        first = reading;
        ramped = 0;
    } else {
        ramped += span;
    }
    float way = to - first, gone = ramp * (ramped * 1e-3f);
    setpoint = gone < fabsf(way) ? first + (way < 0 ? -gone : gone) : to;
}

static uint16_t counts_of(float output) {
    float counts = (output - settings.zero) * scale + 0.5f;
    return counts >= 1023 ? 1023 : counts > 0 ? (uint16_t)counts : 0; /* also for NaN */
}

/* Schedules the output at its time. */
static void put_out(uint16_t counts) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (running) {
            computed = counts;
            TIFR2 = _BV(OCF2B); /* of an earlier millisecond */
            TIMSK2 |= _BV(OCIE2B);
        }
    }
}

/* Sets the output pin, and counts when. */
ISR(TIMER2_COMPB_vect) {
    TIMSK2 &= ~_BV(OCIE2B);
    if (!pressure_regulate(computed))
        return;
    uint16_t now = since_due();
    count(&delay, now, DELAY_BIN);
    if (updates++)
        count(&jitter, now > last_delay ? now - last_delay : last_delay - now, JITTER_BIN);
    last_delay = now;
    saturated += pid.saturated;
}

static void update(void) {
    float reading = read_input(), ahead;
    if (!(reading >= settings.reading_low && reading <= settings.reading_high)) {
        missed++;
        return;
    }
    uint16_t span;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        span = elapsed;
        elapsed = 0;
        ahead = settings.ahead;
    }
    move_setpoint(reading, span);
    pid_update(&pid, &settings.pid, reading, setpoint, ahead, span * 1e-3f, bumpless, clamping);
    put_out(counts_of(pid.output));
}

ISR(TIMER2_COMPA_vect) {
    ago++;
    if (--to_go)
        return;
    to_go = period;
    if (elapsed <= UINT16_MAX - period)
        elapsed += period;
    if (busy) {
        late++;
        return;
    }
    ago = 0;
    busy = true;
    sei();
    update();
    cli();
    busy = false;
}

/* --- the host's side --------------------------------------------------------------------------------------- */
bool control_running(void) { return running; }

void control_halt(void) {
    running = false;
    TIMSK2 = 0;
    TCCR2B = 0;
}

int16_t control_clear(void) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { control_halt(); }
    given = period = 0;
    return E_NONE;
}

int16_t control_input(uint8_t number) {
    if (running)
        return E_CONFLICT;
    channel = number;
    return E_NONE;
}

int16_t control_period(uint16_t ms) {
    if (running)
        return E_CONFLICT;
    period = ms;
    return E_NONE;
}

/* `name,value`; while the loop runs, only the set-point, its ramp and the feed-forward. */
int16_t control_parameter(char *text) {
    char *comma = strchr(text, ','), *end;
    if (!comma)
        return E_MISSING;
    *comma = 0;
    for (uint8_t i = 0; i < COUNT; i++) {
        if (strcmp_P(text, NAMES[i]))
            continue;
        float value = strtod(comma + 1, &end);
        if (end == comma + 1 || *end || isnan(value))
            return E_DATA_TYPE;
        if (isinf(value) && i != RAMP && i != RATE && i != TRACKING)
            return E_RANGE;
        if (running && i != TO && i != RAMP && i != AHEAD)
            return E_CONFLICT;
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { ((float *)&settings)[i] = value; }
        given |= 1UL << i;
        return E_NONE;
    }
    return E_DATA_TYPE;
}

static bool sound(void) {
    const pid_settings_t *with = &settings.pid;
    return given == ALL && period && settings.full != settings.zero && with->low <= with->high && with->rate > 0 &&
           settings.ramp > 0 && settings.reading_low < settings.reading_high &&
           (with->derivative == 0 || with->filter_time > 0) && (with->integral == 0 || with->tracking_time > 0);
}

/* Idempotent, since a host whose answer was lost repeats the command. */
int16_t control_start(bool from_here, bool clamped) {
    if (running)
        return E_NONE;
    if (!sound())
        return E_CONFLICT;
    bumpless = from_here;
    clamping = clamped;
    scale = 1023 / (settings.full - settings.zero);
    for (degree = 3; degree && settings.calibration[degree] == 0;)
        degree--;
    pid_begin(&pid, settings.zero + pressure_counts() / scale);
    updates = late = missed = saturated = 0;
    memset(&jitter, 0, sizeof jitter);
    memset(&delay, 0, sizeof delay);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (!trips()) { /* one that came just now has halted nothing yet */
            to_go = 1;
            elapsed = ago = 0;
            TCCR2A = _BV(WGM21);
            OCR2A = TICK_COUNTS - 1;
            OCR2B = OUTPUT_COUNT;
            TCNT2 = 0;
            TIFR2 = _BV(OCF2A);
            TCCR2B = _BV(CS22); /* 16 MHz / 64 */
            running = true;
            TIMSK2 = _BV(OCIE2A);
        }
    }
    return running ? E_NONE : E_CONFLICT;
}

static uint32_t in_bin(const spread_t *spread, uint8_t bin) {
    uint32_t counted;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { counted = spread->bins[bin]; }
    return counted;
}

/* The upper edge of the bin of a quantile, us; for the last bin the largest value. */
static uint32_t quantile(const spread_t *spread, uint8_t percent, uint8_t width) {
    uint32_t total = 0, below = 0;
    uint16_t largest;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { largest = spread->largest; }
    for (uint8_t i = 0; i < BINS; i++)
        total += in_bin(spread, i);
    uint32_t rank = total < 40000000UL ? (total * percent + 99) / 100 : total / 100 * percent;
    for (uint8_t i = 0; i < BINS - 1; i++) {
        below += in_bin(spread, i);
        uint16_t edge = (i + 1) * width;
        if (below >= rank && edge < largest)
            return (uint32_t)edge * COUNT_US;
        if (below >= rank)
            break;
    }
    return (uint32_t)largest * COUNT_US;
}

/* Updates, late, missed, saturated; of jitter and delay each 50 %, 99 % and the largest, us. */
void control_figures(uint32_t *figures) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        figures[0] = updates;
        figures[1] = late;
        figures[2] = missed;
        figures[3] = saturated;
    }
    figures[4] = quantile(&jitter, 50, JITTER_BIN);
    figures[5] = quantile(&jitter, 99, JITTER_BIN);
    figures[6] = quantile(&jitter, 100, JITTER_BIN);
    figures[7] = quantile(&delay, 50, DELAY_BIN);
    figures[8] = quantile(&delay, 99, DELAY_BIN);
    figures[9] = quantile(&delay, 100, DELAY_BIN);
}

void control_state(float *wanted, float *output) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        *wanted = setpoint;
        *output = pid.output;
    }
}
