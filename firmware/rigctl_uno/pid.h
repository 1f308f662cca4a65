/* A PID controller in parallel form; the same equations, in the same order, as rigctl's own on the host.
 *
 *   v = ahead + gain*e + I + D                      e = set-point - reading
 *   dI/dt = integral*e + (u - v)/tracking_time      back-calculation
 *   filter_time*dD/dt + D = -derivative*dy/dt       of the reading
 *   u = v within low, high and rate
 *
 * After Astrom and Hagglund, Advanced PID Control (ISA, 2006): the integral by the forward difference, the derivative
 * by the backward one. All values are in the units that the host has sent; a float has 24 bits. */
#ifndef PID_H
#define PID_H

#include <stdbool.h>

typedef struct {
    float gain, integral, derivative, filter_time, tracking_time;
    float low, high, rate; /* of the output; rate per s, infinite without any */
} pid_settings_t;

typedef struct {
    float output;
    bool saturated; /* the newest output was bounded */
    /* internal state */
    float sum, lost, slope, reading;
    bool begun;
} pid_state_t;

void pid_begin(pid_state_t *pid, float output);
/* One update, `span` s after the previous one; ignored for the first. */
void pid_update(pid_state_t *pid, const pid_settings_t *with, float reading, float setpoint, float ahead, float span,
                bool bumpless, bool clamping);

#endif
