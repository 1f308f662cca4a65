#include "pid.h"

#include <math.h>

void pid_begin(pid_state_t *pid, float output) { *pid = (pid_state_t){.output = output}; }

/* Adds to the integral what is too small for its 24 bits as well (Kahan's summation): a thousand updates a second
 * each add very little. */
static void add(pid_state_t *pid, float rise) {
    float wanted = rise - pid->lost, sum = pid->sum + wanted;
    if (!isfinite(sum)) /* it would stay in the integral for ever */
        return;
    pid->lost = (sum - pid->sum) - wanted;
    pid->sum = sum;
}

static float bounded(const pid_settings_t *with, float value, float before, float span) {
    if (with->rate < __FLT_MAX__) {
        float reach = with->rate * span;
        if (value < before - reach)
            value = before - reach;
        if (value > before + reach)
            value = before + reach;
    }
    if (value < with->low)
        value = with->low;
    return value > with->high ? with->high : value;
}

static void integrate(pid_state_t *pid, const pid_settings_t *with, float error, float excess, float span,
                      bool clamping) {
    float rise = with->integral * error * span;
    if (clamping) {
        if (!pid->saturated || (rise > 0 && excess > 0) || (rise < 0 && excess < 0))
            add(pid, rise);
        return;
    }
    if (pid->saturated && with->integral != 0)
        rise += span < with->tracking_time ? excess * (span / with->tracking_time) : excess;
    add(pid, rise);
}

void pid_update(pid_state_t *pid, const pid_settings_t *with, float reading, float setpoint, float ahead, float span,
                bool bumpless, bool clamping) {
    float error = setpoint - reading, proportional = with->gain * error;
    if (!pid->begun) {
        span = 0;
        if (bumpless && with->integral != 0)
            add(pid, pid->output - proportional - ahead);
        pid->begun = true;
    } else if (with->derivative != 0) {
        pid->slope = (with->filter_time * pid->slope - with->derivative * (reading - pid->reading)) /
                     (with->filter_time + span);
    }
    pid->reading = reading;
    float wanted = ahead + proportional + pid->sum + pid->slope;
    if (isnan(wanted)) { /* overflowing terms have no defined sum */
        pid->saturated = true;
        return;
    }
    pid->output = bounded(with, wanted, pid->output, span);
    pid->saturated = pid->output != wanted;
    integrate(pid, with, error, pid->output - wanted, span, clamping);
}
