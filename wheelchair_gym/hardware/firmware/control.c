#include "control.h"

#include <math.h>

#define THERE 1e-6F      /* m/s, rad/s: an approach that is this near has arrived */
#define LEVEL 1.0F       /* V at rest: less is friction, not a slope */
#define LOAD_SHARE SPAN  /* low-pass of 1 s */
#define SLOW 0.1F        /* m/s, of aim and wheel: a slope may turn it back */
/* Where a chair turns on a slope, its load changes: by 5.5 V/s at 1 rad/s, 180 kg and 8 degrees. The
 * integral follows at an error of 5.5 V/s / ki = 0.046 m/s, which is more than half of the aim of a
 * wheel that runs on a circle of less than this. It then misses up to 26 mm in half a turn. */
#define PIVOT 0.1F       /* m */
#define PIVOT_WAY 0.03F  /* m that it may miss */
#define MOVES 3          /* counts, net: an encoder that lost a channel gives one, to and fro */

static float least(float a, float b) { return a < b ? a : b; }
static float most(float a, float b) { return a > b ? a : b; }

void approach(axis_t *axis, float target, float up, float down, float jerk, float dt, float per_dt)
{
    float gap = target - axis->speed;
    if (gap == 0.0F && axis->slope == 0.0F)
        return;
    bool braking = axis->speed != 0.0F && (axis->speed > 0.0F) != (gap > 0.0F);
    float far = fabsf(gap), step = jerk * dt;
    /* The rate from which jerk can still bring the slope to zero when the target is reached. */
    float final = sqrtf(2.0F * jerk * far + 0.25F * step * step) - 0.5F * step;
    float wanted = copysignf(least(braking ? down : up, least(final, far * per_dt)), gap);
    float slope = axis->slope + least(step, most(-step, wanted - axis->slope));
    float after = axis->speed + slope * dt;
    bool there = (target - after) * gap <= 0.0F || fabsf(target - after) < THERE;
    if (there && fabsf(slope) <= 2.0F * step) {
        axis->speed = target;
        axis->slope = 0.0F;
    } else {
        axis->speed = after;
        axis->slope = slope;
    }
}

void fall(axis_t *axis, float bound, float rate, float dt)
{
    float gap = bound - axis->speed;
    axis->speed += copysignf(least(fabsf(gap), rate * dt), gap);
    axis->slope = 0.0F;
}

void work_out(worked_t *k, const drive_values_t *p)
{
    k->count = 1.0F / p->counts_per_metre;
    k->pivot = least(1.0F, p->missing * (1.0F / PIVOT_WAY));
    k->per_track = 1.0F / most(p->track, 0.1F);
    k->hasten = 1.0F / (p->smoothing + RUN);
}

void time_run(worked_t *k, float run)
{
    k->run = run;
    k->per_run = 1.0F / run;
    k->share = least(1.0F, k->hasten * run);
    k->quantum = k->count * k->per_run;
}

void measure_wheel(wheel_t *wheel, const worked_t *k, int32_t counts, float turn)
{
    float measured = (float)(counts - wheel->counts) * k->quantum;
    wheel->counts = counts;
    wheel->speed += k->share * (measured - wheel->speed);
    /* The way that is missing against half of the aim: grows when counts stay away. */
    float aim = fabsf(wheel->aim), progress = wheel->aim < 0.0F ? -measured : measured, share = 1.0F;
    bool slow = aim < SLOW && fabsf(wheel->speed) < SLOW;
    if (slow) {
        progress = most(0.0F, progress);
        share = aim < PIVOT * turn ? k->pivot : 1.0F;
    }
    /* Such a wheel rolls back, or passes briefly through rest: without any move it misses less. */
    int32_t moved = counts - wheel->mark;
    if (!slow || moved >= MOVES || moved <= -MOVES) {
        wheel->mark = counts;
        wheel->silent = 0.0F;
    } else {
        wheel->silent += 0.5F * aim * k->run;
    }
    wheel->behind = most(0.0F, wheel->behind + share * (0.5F * aim - progress) * k->run);
    if (wheel->aim == 0.0F)
        wheel->behind = wheel->silent = 0.0F;
}

float way_beyond(wheel_t *wheel, const worked_t *k, float fall)
{
    float far = 0.0F, way = (float)(wheel->counts - wheel->from) * k->count;
    for (uint8_t i = 0; i < 2; i++) {
        float aim = i ? -least(wheel->aim, wheel->aim_from) : most(wheel->aim, wheel->aim_from);
        wheel->may[i] = most(most(0.0F, aim), wheel->may[i] - fall * wheel->span);
        float over = (i ? -way : way) - wheel->may[i] * wheel->span;
        wheel->sum_over[i] += over - wheel->past[i][wheel->at];
        wheel->past[i][wheel->at] = over;
        far = most(far, wheel->sum_over[i]);
    }
    wheel->at = (uint8_t)((wheel->at + 1) % SPANS);
    wheel->from = wheel->counts;
    wheel->span = 0.0F;
    wheel->aim_from = wheel->aim;
    return far;
}

void lengthen_span(wheel_t *wheel, const worked_t *k) { wheel->span += k->run; }

void excuse_wheel(wheel_t *wheel)
{
    wheel->from = wheel->counts;
    wheel->span = 0.0F;
    for (uint8_t i = 0; i < 2; i++) {
        wheel->may[i] = most(wheel->may[i], fabsf(wheel->speed));
        wheel->sum_over[i] = 0.0F;
        for (uint8_t j = 0; j < SPANS; j++)
            wheel->past[i][j] = 0.0F;
    }
}

float way_from_home(const wheel_t *wheel, const worked_t *k)
{
    return (float)(wheel->counts - wheel->home) * k->count;
}

float control_wheel(wheel_t *wheel, const drive_values_t *p, const worked_t *k, float target, float rate,
                    float battery, bool held)
{
    /* The target passes the same low-pass, so that its delay does not wind up the integral. */
    float before = wheel->aim;
    wheel->aim += k->share * (target - wheel->aim);
    if (before * wheel->aim < 0.0F) /* it turns back: its way begins anew */
        wheel->behind = wheel->silent = 0.0F;
    float error = wheel->aim - wheel->speed;
    float slope = (error - wheel->error) * k->per_run;
    wheel->error = error;
    float volts = p->feed * target + p->ka * rate + p->kp * error + wheel->sum + p->kd * slope;
    if (held) {
        /* What held it on its slope goes on; a spring to where it stands takes what is missing. */
        volts -= p->hold * way_from_home(wheel, k);
        wheel->behind = wheel->silent = 0.0F;
        if (fabsf(wheel->aim) < THERE)
            wheel->aim = 0.0F;
    } else if (fabsf(volts) < battery) {
        wheel->sum += p->ki * error * k->run;
    }
    wheel->rate = rate;
    return wheel->volts = least(battery, most(-battery, volts));
}

void weigh_wheel(wheel_t *wheel, const drive_values_t *p)
{
    float load = wheel->volts - p->feed * wheel->speed - p->ka * wheel->rate;
    wheel->load += LOAD_SHARE * (load - wheel->load);
}

void rest_wheel(wheel_t *wheel)
{
    wheel->home = wheel->counts;
    if (fabsf(wheel->sum) < LEVEL)
        wheel->sum = 0.0F; /* both ends of the motor are joined: it holds without current */
}

void release_wheel(wheel_t *wheel)
{
    wheel->aim = wheel->sum = wheel->error = wheel->load = 0.0F;
    wheel->behind = wheel->silent = 0.0F;
}

void leave_home(wheel_t *wheel, const drive_values_t *p, const worked_t *k)
{
    wheel->sum -= p->hold * way_from_home(wheel, k);
}
