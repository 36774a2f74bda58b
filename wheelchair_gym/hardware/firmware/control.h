/* Set points and wheels: the arithmetic of wheelchair_gym.geometry.kinematics and simulation.motion. */
#ifndef CONTROL_H
#define CONTROL_H

#include "protocol.h"

#define RUN 0.005F /* s: 200 Hz; each run measures what it was */

#define VALUE(name, initial, low, high, unit) float name;
typedef struct { DRIVE_PARAMETERS(VALUE) } drive_values_t;

typedef struct {
    float speed; /* m/s or rad/s */
    float slope; /* its rate of change */
} axis_t;

/* Move a speed towards its target within limits of rate and jerk: kinematics.approach. */
void approach(axis_t *axis, float target, float up, float down, float jerk, float dt,
              float per_dt);

/* Move a speed towards a bound at a rate, exempt from jerk. */
void fall(axis_t *axis, float bound, float rate, float dt);

#define SPANS 4      /* of the time over which a wheel that is too fast is looked at */
#define SPAN_RUNS 5U
#define SPAN (SPAN_RUNS * RUN) /* s: 25 ms each, 0.1 s in all, where runs are in time */

typedef struct {
    int32_t counts;
    float speed;    /* m/s, low-passed */
    float aim;      /* m/s, the target through the same low-pass */
    float sum;      /* V, integral part */
    float error;    /* m/s, of the last run */
    float behind;   /* m that the wheel is behind half of its aim */
    int32_t mark;   /* counts when it was last seen to move, while it is slow */
    float silent;   /* m of half of its aim since then */
    int32_t home;   /* counts at which it came to rest */
    float load;     /* V that the motor gets beyond its back-EMF, low-passed */
    float volts;    /* that it gets */
    float rate;     /* m/s2 that it is to have */
    int32_t from;   /* counts, when this span began */
    float span;     /* s that it has lasted */
    float aim_from; /* m/s, and the aim */
    float may[2];   /* m/s, forward and backward: the aim, or what it can still be braking from */
    float past[2][SPANS]; /* m that it went beyond that, in the last spans */
    float sum_over[2];    /* of them */
    uint8_t at;     /* the oldest */
} wheel_t;

typedef struct {
    /* Worked out of the parameters between two runs: divisions are slow. */
    float count;   /* m */
    float pivot;   /* weight of what a wheel misses about which the chair turns */
    float per_track; /* 1/m */
    float hasten;  /* 1/s: share of the low-pass, to first order */
    /* And of the time since the last run. */
    float run, per_run; /* s, 1/s */
    float share;   /* of the low-pass */
    float quantum; /* m/s of one count in a run */
} worked_t;

void work_out(worked_t *k, const drive_values_t *p);

/* A run begins, so many seconds after the last. */
void time_run(worked_t *k, float run);

/* Take the encoder's count: the speed since the last run. `turn` [rad/s]: as fast as this the chair
 * is to turn, either way. */
void measure_wheel(wheel_t *wheel, const worked_t *k, int32_t counts, float turn);

/* At the end of a span: the way [m] by which the wheel went beyond its aim in the last SPANS.
 * `fall` [m/s2]: as fast as this it must follow an aim that comes down. */
float way_beyond(wheel_t *wheel, const worked_t *k, float fall);

/* A run has ended: the wheel's span has lasted longer. */
void lengthen_span(wheel_t *wheel, const worked_t *k);

/* What a wheel does now is no runaway: it is pushed by hand, or has just been cut. */
void excuse_wheel(wheel_t *wheel);

/* How far a wheel is from where it came to rest [m]. */
float way_from_home(const wheel_t *wheel, const worked_t *k);

/* One run of PID with feed-forward. Returns volts for the motor within +-battery. `held`: at rest,
 * and to stay there. */
float control_wheel(wheel_t *wheel, const drive_values_t *p, const worked_t *k, float target, float rate,
                    float battery, bool held);

/* It has come to rest here. */
void rest_wheel(wheel_t *wheel);

/* Low-pass, once a span, of what the motor gets beyond the back-EMF of the measured speed and what
 * the acceleration asks. */
void weigh_wheel(wheel_t *wheel, const drive_values_t *p);

/* Forget the past of the control; the measured speed stays. */
void release_wheel(wheel_t *wheel);

/* It is held no longer: what held it on its slope goes on, and it does not roll back. */
void leave_home(wheel_t *wheel, const drive_values_t *p, const worked_t *k);

#endif
