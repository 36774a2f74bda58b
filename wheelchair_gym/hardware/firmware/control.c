#include "control.h"

#include <math.h>

#define THERE 1e-6F /* m/s, rad/s: an approach that is this near has arrived */

static float least(float a, float b) { return a < b ? a : b; }
static float most(float a, float b) { return a > b ? a : b; }

void approach(axis_t *axis, float target, float up, float down, float jerk, float dt)
{
    float gap = target - axis->speed;
    if (gap == 0.0F && axis->slope == 0.0F)
        return;
    bool braking = axis->speed != 0.0F && (axis->speed > 0.0F) != (gap > 0.0F);
    float far = fabsf(gap), step = jerk * dt;
    /* The rate from which jerk can still bring the slope to zero when the target is reached. */
    float final = sqrtf(2.0F * jerk * far + 0.25F * step * step) - 0.5F * step;
    float wanted = copysignf(least(braking ? down : up, least(final, far / dt)), gap);
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

worked_t work_out(const drive_values_t *p)
{
    return (worked_t){RUN / (p->smoothing + RUN), 1.0F / (p->counts_per_metre * RUN)};
}

void measure_wheel(wheel_t *wheel, worked_t k, int32_t counts)
{
    float measured = (float)(counts - wheel->counts) * k.quantum;
    wheel->counts = counts;
    wheel->speed += k.share * (measured - wheel->speed);
    /* The way that is missing against half of the aim: grows when counts stay away. */
    float progress = wheel->aim < 0.0F ? -measured : measured;
    wheel->behind = most(0.0F, wheel->behind + (0.5F * fabsf(wheel->aim) - progress) * RUN);
    if (wheel->aim == 0.0F)
        wheel->behind = 0.0F;
}

float control_wheel(wheel_t *wheel, const drive_values_t *p, worked_t k, float target, float rate,
                    float battery)
{
    /* The target passes the same low-pass, so that its delay does not wind up the integral. */
    wheel->aim += k.share * (target - wheel->aim);
    float error = wheel->aim - wheel->speed;
    float slope = (error - wheel->error) * (1.0F / RUN);
    wheel->error = error;
    float volts = p->feed * target + p->ka * rate + p->kp * error + wheel->sum + p->kd * slope;
    if (target == 0.0F && fabsf(wheel->speed) < 0.5F * k.quantum) {
        /* At rest both ends of the motor are joined: it holds without drawing current. */
        wheel->sum = volts = 0.0F;
        if (fabsf(wheel->aim) < THERE)
            wheel->aim = 0.0F;
    } else if (fabsf(volts) < battery) {
        wheel->sum += p->ki * error * RUN;
    }
    return least(battery, most(-battery, volts));
}

void release_wheel(wheel_t *wheel)
{
    wheel->aim = wheel->sum = wheel->error = wheel->behind = 0.0F;
}
