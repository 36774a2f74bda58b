/* Set points and wheels: the arithmetic of wheelchair_gym.kinematics and simulation.motion. */
#ifndef CONTROL_H
#define CONTROL_H

#include "protocol.h"

#define RUN 0.005F /* s: 200 Hz */

#define VALUE(name, initial, low, high, unit) float name;
typedef struct { DRIVE_PARAMETERS(VALUE) } drive_values_t;

typedef struct {
    float speed; /* m/s or rad/s */
    float slope; /* its rate of change */
} axis_t;

/* Move a speed towards its target within limits of rate and jerk: kinematics.approach. */
void approach(axis_t *axis, float target, float up, float down, float jerk, float dt);

/* Move a speed towards a bound at a rate, exempt from jerk. */
void fall(axis_t *axis, float bound, float rate, float dt);

typedef struct {
    int32_t counts;
    float speed;    /* m/s, low-passed */
    float aim;      /* m/s, the target through the same low-pass */
    float sum;      /* V, integral part */
    float error;    /* m/s, of the last run */
    float behind;   /* m that the wheel is behind half of its aim */
} wheel_t;

/* Worked out of the parameters once a run: divisions are slow. */
typedef struct {
    float share;   /* of the low-pass */
    float quantum; /* m/s of one count in a run */
} worked_t;

worked_t work_out(const drive_values_t *p);

/* Take the encoder's count: the speed since the last run. */
void measure_wheel(wheel_t *wheel, worked_t k, int32_t counts);

/* One run of PID with feed-forward. Returns volts for the motor within +-battery. */
float control_wheel(wheel_t *wheel, const drive_values_t *p, worked_t k, float target, float rate,
                    float battery);

/* Forget the past of the control; the measured speed stays. */
void release_wheel(wheel_t *wheel);

#endif
