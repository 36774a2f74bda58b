#include "drive.h"

#include <math.h>
#include <string.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#else
#define PROGMEM
#endif

#define MIN_BATTERY 10.0F  /* V: what volts are divided by at least */
#define BATTERY_SHARE 0.05F  /* of a reading a run: low-pass of 0.1 s */
#define REST 0.03F           /* m/s at the rims: less is at rest; one count a run is 0.046 */
#define CREEP_TURN 0.2F      /* rad/s, while a strip is pressed */
#define OVERRUN_MAX 10000U  /* us that runs may be late, each or by and by; then OVERRUN */
#define OVERRUN_EACH 5500U   /* us of a run that is not late: 10 % is forgiven */
#define SHORTEST 1000U       /* us of a run */
#define LONGEST 50000U       /* us; the watchdog timer ends longer ones */
#define SAG 500U             /* ms below `under_voltage`: starting currents pass */
#define LOOK 100U            /* ms over which impossible encoder steps are counted */
#define ILLEGAL_MAX 20U     /* in that time: a few are noise */
#define RUNAWAY_AFTER 500U   /* ms at set point zero: from here it goes no further than HOLD_MAX */
#define SPAN_TIME (SPANS * SPAN) /* s over which a wheel must be too fast */
#define FOLLOW 1.5F          /* m/s2 by which a wheel follows a falling aim, at least */
#define BRAKED 0.5F          /* m/s2 of the closed brakes alone, at least: 180 kg down 8 degrees */
#define TAKE_OVER 150U       /* ms for the motors to take a chair from its brakes */
#define HOLD_MAX 0.05F      /* m from there, or from where it came to rest: it is not held */
#define SLIPS_MAX 3         /* of closed brakes: they do not hold */
#define PUSHED 0.35F         /* m/s: shorted motors let 180 kg roll down 8 degrees at 0.24 m/s */
#define FORGET 60000U        /* ms after which an older slip is no sign any longer */

/* What takes the drivers' power and closes the brakes at once: control itself may be what fails. */
#define CUTTING                                                                      \
    (EMERGENCY_STOP | STALL | DIRECTION | ENCODER | OVER_SPEED | DRIVER | RUNAWAY |  \
     IMPLAUSIBLE)

/* Faults with which the motors may still hold the chair where its brakes slip. */
#define HOLDABLE (LINK | UNDER_VOLTAGE | BRAKE)

#define BOUNDS(name, initial, low, high, unit) {initial, low, high},
static const bounds_t bounds[] PROGMEM = {DRIVE_PARAMETERS(BOUNDS)};
#define COUNT ((uint8_t)(sizeof bounds / sizeof bounds[0]))
_Static_assert(sizeof bounds / sizeof bounds[0] <= PARAMETERS_MAX, "the store is too small");

void drive_begin(drive_t *drive)
{
    memset(drive, 0, sizeof *drive);
    drive->parameters = (parameters_t){bounds, &drive->p.track, COUNT, DRIVE_BOARD, false};
    use_defaults(&drive->parameters);
    drive->faults = RESET;
    drive->slowest = drive->p.over_speed;
}

void drive_restored(drive_t *drive)
{
    if (!drive->parameters.stored)
        drive->faults |= STORE;
}

static bool wheels_rest(const drive_t *drive)
{
    return fabsf(drive->wheels[0].speed) < REST && fabsf(drive->wheels[1].speed) < REST;
}

bool drive_at_rest(const drive_t *drive)
{
    return drive->v.speed == 0.0F && drive->w.speed == 0.0F && wheels_rest(drive);
}

static uint16_t milliseconds(float seconds) { return (uint16_t)(seconds * 1000.0F + 0.5F); }

static bool command_fresh(const drive_t *drive, uint32_t now)
{
    return drive->commanded && now - drive->command_at < milliseconds(drive->p.timeout);
}

/* Causes of faults that stand now, as far as switches and meters tell. */
static bool cause_stands(const drive_t *drive)
{
    return drive->inputs.switches & (STOP_PRESSED | FREEWHEEL | DRIVER_LEFT | DRIVER_RIGHT) ||
           drive->battery < drive->p.under_voltage ||
           (drive->faults & STORE && !drive->parameters.stored);
}

/* Whether the brakes may be trusted with the chair: they have not slipped just now. */
static bool brakes_hold(const drive_t *drive, uint32_t now)
{
    return !(drive->faults & BRAKE) &&
           (!drive->slips || now - drive->slipped_at > milliseconds(drive->p.park));
}

static uint8_t rearm(drive_t *drive, uint16_t seen, bool zero, uint32_t now)
{
    if (drive->faults & ~seen)
        return OTHER_FAULTS;
    bool standing = drive->mode == STOPPED || (drive->mode == STOPPING && drive->held);
    if (!standing || !drive_at_rest(drive))
        return drive->armed && !drive->faults && drive->mode != STOPPING ? DONE : MOVING;
    if (cause_stands(drive))
        return CAUSE_STANDS;
    if (!zero)
        return NOT_AT_ZERO;
    drive->faults &= (uint16_t)~seen; /* none is left: others were refused above */
    drive->slips = 0;
    drive->armed = true;
    drive->joystick.free = false;
    drive->host_free = true; /* zero was asked for just now */
    drive->valid_at = now;
    return DONE;
}

static void measure(drive_t *drive, const worked_t *k, const inputs_t *in)
{
    float turn = fabsf(drive->w.speed);
    for (uint8_t i = 0; i < 2; i++) {
        if (!drive->begun)
            drive->wheels[i].counts = drive->wheels[i].from = in->counts[i];
        measure_wheel(&drive->wheels[i], k, in->counts[i], turn);
    }
    if (!drive->begun) {
        drive->battery = in->battery;
        drive->illegal = in->illegal;
        drive->begun = true;
    }
    drive->battery += BATTERY_SHARE * (in->battery - drive->battery);
    drive->inputs = *in;
    drive->pressed |= in->switches;
}

/* Latch that the chair does not come to rest, or does not stay there. */
static void watch_rest(drive_t *drive, const worked_t *k, const inputs_t *in)
{
    bool late = in->now - drive->moved_at > RUNAWAY_AFTER, moves = false;
    for (uint8_t i = 0; i < 2 && drive->running; i++) {
        /* Who is pushed, or has coarse encoders, comes to rest later, but not far from here. */
        if (!drive->held && !late)
            drive->wheels[i].home = drive->wheels[i].counts;
        else if (fabsf(way_from_home(&drive->wheels[i], k)) > HOLD_MAX + k->count)
            moves = true;
    }
    if (moves)
        drive->faults |= RUNAWAY;
    if (in->switches & FREEWHEEL) {
        excuse_wheel(&drive->wheels[0]); /* it is pushed by hand */
        excuse_wheel(&drive->wheels[1]);
    }
}

void drive_look(drive_t *drive)
{
    work_out(&drive->k, &drive->p); /* here there is time for it */
    drive->per_battery = 1.0F / fmaxf(drive->battery, MIN_BATTERY);
    const worked_t *k = &drive->k;
    drive->span = (uint8_t)(drive->span + 1U) % SPAN_RUNS;
    for (uint8_t i = 0; i < 2; i++) {
        wheel_t *wheel = &drive->wheels[i];
        lengthen_span(wheel, k);
        if (drive->span != 2 * i) /* one wheel in a run: the runs take more equal times */
            continue;
        float most = drive->p.runaway * SPAN_TIME + k->count;
        if (way_beyond(wheel, k, drive->running ? FOLLOW : BRAKED) > most)
            drive->faults |= RUNAWAY;
        /* Braking hard and holding ask for more than any load does in driving. */
        if (drive->driving)
            weigh_wheel(wheel, &drive->p);
        else
            wheel->load = 0.0F;
        if (fabsf(wheel->load) > drive->p.load)
            drive->faults |= IMPLAUSIBLE;
    }
}

/* Closed brakes that slip: count it, and let the motors hold the chair where they may. */
static void watch_brakes(drive_t *drive, const worked_t *k, const inputs_t *in)
{
    float bound = drive->p.slip + k->count;
    if (!drive->shut || drive->faults & BRAKE ||
        (fabsf(way_from_home(&drive->wheels[0], k)) < bound &&
         fabsf(way_from_home(&drive->wheels[1], k)) < bound))
        return;
    if (in->now - drive->slipped_at > FORGET)
        drive->slips = 0;
    drive->slipped_at = in->now;
    drive->shut = drive->parked = false;
    if (++drive->slips >= SLIPS_MAX)
        drive->faults |= BRAKE;
    if (drive->mode == STOPPED && !(drive->faults & (uint16_t)~HOLDABLE) && !cause_stands(drive))
        drive->mode = STOPPING;
}

/* Latch what is wrong. */
static void watch(drive_t *drive, const worked_t *k, const inputs_t *in)
{
    float missing = drive->p.missing + k->count; /* whole counts are seen */
    watch_rest(drive, k, in);
    watch_brakes(drive, k, in);
    if (drive->late > OVERRUN_MAX)
        drive->faults |= OVERRUN;
    if (in->switches & STOP_PRESSED)
        drive->faults |= EMERGENCY_STOP;
    if (in->switches & (DRIVER_LEFT | DRIVER_RIGHT) && drive->mode != STOPPED && !drive->parked)
        drive->faults |= DRIVER;
    for (uint8_t i = 0; i < 2; i++) {
        const wheel_t *wheel = &drive->wheels[i];
        if (fabsf(wheel->speed) > drive->p.over_speed)
            drive->faults |= OVER_SPEED;
        if (wheel->behind > missing || wheel->silent > missing)
            drive->faults |= wheel->speed * wheel->aim < -REST * fabsf(wheel->aim) ? DIRECTION : STALL;
    }
    if (in->now - drive->look_at >= LOOK) {
        if ((uint8_t)(in->illegal - drive->illegal) > ILLEGAL_MAX)
            drive->faults |= ENCODER;
        drive->illegal = in->illegal;
        drive->look_at = in->now;
    }
    if (drive->battery >= drive->p.under_voltage)
        drive->low_at = in->now;
    else if (in->now - drive->low_at > SAG)
        drive->faults |= UNDER_VOLTAGE;
    if (in->switches & FREEWHEEL && (drive->armed || drive->mode != STOPPED))
        drive->faults |= LEVER;
    if (drive->faults || in->switches & FREEWHEEL)
        drive->armed = false;
}

typedef struct {
    float v, w;
    bool protective;
} target_t;

/* What is asked for, by whoever may ask. Returns false if nobody does. */
static bool choose(drive_t *drive, uint32_t now, target_t *target)
{
    const joystick_t *stick = &drive->joystick;
    bool heard = joystick_fresh(stick, now), fresh = heard, free = heard && stick->free;
    if (heard && stick->manual != drive->manual) {
        drive->manual = stick->manual;
        drive->host_free = false;
    }
    if (drive->manual) {
        /* A joystick that falls silent keeps the chair: the host never takes over by itself. */
        float v = drive->p.manual * stick->ahead;
        *target = (target_t){v * (v > 0.0F ? drive->p.forward : drive->p.backward),
                             drive->p.manual * stick->aside * drive->p.turn, false};
        if (heard && stick->held && !drive->was_held)
            rearm(drive, UINT16_MAX, joystick_centred(stick), now);
        if (heard)
            drive->was_held = stick->held;
    } else {
        fresh = command_fresh(drive, now);
        *target = (target_t){(float)drive->command.v * 1e-4F, (float)drive->command.w * 1e-4F,
                             (drive->command.flags & PROTECTIVE) != 0};
        bool zero = drive->command.v == 0 && drive->command.w == 0;
        drive->host_free = interlock(drive->host_free, true, fresh && zero);
        if (!(drive->command.flags & ASSISTED))
            free = drive->host_free;
        else if (joystick_centred(stick)) /* the person's hand goes before the host */
            *target = (target_t){0.0F, 0.0F, target->protective};
    }
    if (!free) /* somebody takes over from a moving chair, or has let go of it */
        *target = (target_t){0.0F, 0.0F, true};
    return fresh;
}

/* A strip that is pressed stops the chair, whatever its way: it may yet turn, or its wheels lag. */
static void feel(drive_t *drive)
{
    uint8_t pressed = drive->inputs.switches & STRIPS;
    if (pressed & (uint8_t)~drive->strips)
        drive->touched = true;
    if (drive_at_rest(drive))
        drive->touched = false;
    drive->strips = pressed;
}

/* Who drives from here on, or how the chair comes to rest. */
static void decide(drive_t *drive, bool asked, uint32_t now)
{
    if (drive->armed && asked) {
        drive->valid_at = now;
        drive->mode = drive->manual ? MANUAL : HOST;
        return;
    }
    if (drive->armed && now - drive->valid_at > milliseconds(drive->p.latch)) {
        drive->faults |= LINK;
        drive->armed = false;
    }
    if (drive->mode == HOST || drive->mode == MANUAL)
        drive->mode = STOPPING;
    if (drive->mode == STOPPING && drive_at_rest(drive) && brakes_hold(drive, now))
        drive->mode = STOPPED;
    if (drive->faults & CUTTING || drive->inputs.switches & FREEWHEEL)
        drive->mode = STOPPED;
}

static float clamp(float value, float low, float high)
{
    return value < low ? low : value > high ? high : value;
}

static bool moves(const drive_t *drive)
{
    return drive->v.speed != 0.0F || drive->v.slope != 0.0F || drive->w.speed != 0.0F ||
           drive->w.slope != 0.0F;
}

static void move_set_point(drive_t *drive, target_t target)
{
    const drive_values_t *p = &drive->p;
    const float per_track = drive->k.per_track, run = drive->k.run, per_run = drive->k.per_run;
    drive->wants = false;
    if (drive->mode == STOPPED) {
        drive->v = drive->w = (axis_t){0.0F, 0.0F};
        return;
    }
    if (drive->mode == STOPPING || drive->touched || target.protective) {
        /* Along the same curve, which was found clear: both fall together. */
        float rate = target.protective && drive->mode != STOPPING ? p->protective : p->stop;
        float fastest = fmaxf(fabsf(drive->v.speed), fabsf(drive->w.speed) / per_track);
        float kept = fastest > rate * run ? 1.0F - rate * run / fastest : 0.0F;
        drive->v = (axis_t){kept * drive->v.speed, 0.0F};
        drive->w = (axis_t){kept * drive->w.speed, 0.0F};
        return;
    }
    float low = -p->backward, high = p->forward, turn = p->turn;
    uint8_t pressed = drive->inputs.switches & STRIPS;
    if (pressed) {
        /* Where along a strip it touches is not known: all of a pressed side must move away. A side
         * strip reaches before and behind the axle, and either turn moves one of its ends out. */
        low = pressed & REAR ? 0.0F : -fminf(p->creep, p->backward);
        high = pressed & FRONT ? 0.0F : fminf(p->creep, p->forward);
        bool sides = pressed & (LEFT | RIGHT) || (pressed & (FRONT | REAR)) == (FRONT | REAR);
        float away = pressed & FRONT ? -drive->v.speed : drive->v.speed;
        turn = sides ? 0.0F : clamp(away / p->half_width, 0.0F, CREEP_TURN);
    }
    /* What a strip forbids ends at once; within bounds the limits of comfort hold. */
    if (drive->v.speed < low || drive->v.speed > high)
        fall(&drive->v, clamp(drive->v.speed, low, high), p->stop, run);
    else
        approach(&drive->v, clamp(target.v, low, high), p->acceleration, p->deceleration, p->jerk,
                 run, per_run);
    if (fabsf(drive->w.speed) > turn)
        fall(&drive->w, copysignf(turn, drive->w.speed), p->stop * per_track, run);
    else
        approach(&drive->w, clamp(target.w, -turn, turn), p->turn_acceleration,
                 p->turn_acceleration, p->turn_jerk, run, per_run);
    /* Behind brakes that open the motors take the chair over first: a slope shows only now. */
    if (moves(drive) && drive->inputs.now - drive->open_at < TAKE_OVER) {
        drive->v = drive->w = (axis_t){0.0F, 0.0F};
        drive->wants = true;
    }
}

/* A chair whose set point is zero stays where it came to rest: the motors hold it, and after a
 * while, or in a protective stop at once, the brakes. */
static void keep(drive_t *drive, target_t target, const worked_t *k, uint32_t now)
{
    bool still = !moves(drive) && !drive->wants;
    if (drive->mode != HOST && drive->mode != MANUAL)
        drive->parked = false;
    if (!still)
        drive->parked = false;
    if (drive->mode == STOPPED) {
        drive->held = false;
    } else if (drive->held && moves(drive)) {
        drive->held = false;
        for (uint8_t i = 0; i < 2; i++)
            leave_home(&drive->wheels[i], &drive->p, k);
    } else if (!drive->held && !drive->parked && !moves(drive) && drive_at_rest(drive)) {
        drive->held = true;
        drive->held_at = now;
        for (uint8_t i = 0; i < 2; i++)
            rest_wheel(&drive->wheels[i]);
    }
    bool settled = now - drive->held_at > milliseconds(drive->p.park);
    if (drive->held && still && drive->mode != STOPPING && brakes_hold(drive, now) &&
        (target.protective || settled)) {
        drive->held = false;
        drive->parked = true;
        drive->learned = settled;
        for (uint8_t i = 0; i < 2; i++) {
            if (settled)
                leave_home(&drive->wheels[i], &drive->p, k);
            else
                release_wheel(&drive->wheels[i]);
        }
    }
    if (drive->parked || drive->mode == STOPPED || moves(drive))
        drive->moved_at = now;
}

/* The lever is lifted: the motors alone can brake, their ends joined by drivers at duty 0. It goes on as
 * long as the wheels turn and are no faster for it. */
static bool brake_by_motors(drive_t *drive)
{
    if (!(drive->inputs.switches & FREEWHEEL)) {
        drive->slowest = drive->p.over_speed;
        drive->pushed = false;
        return false;
    }
    float speed = fmaxf(fabsf(drive->wheels[0].speed), fabsf(drive->wheels[1].speed));
    drive->slowest = fminf(drive->slowest, speed);
    if (wheels_rest(drive))
        drive->pushed = false;
    else if (speed > drive->slowest + PUSHED)
        drive->pushed = true;
    return !drive->pushed && !wheels_rest(drive) && !(drive->faults & CUTTING);
}

void drive_step(drive_t *drive, const inputs_t *inputs, outputs_t *outputs)
{
    target_t target;
    axis_t v = drive->v, w = drive->w;
    uint16_t passed = (uint16_t)(RUN * 1e6F);
    if (drive->begun)
        passed = inputs->passed < SHORTEST  ? SHORTEST
                 : inputs->passed > LONGEST ? LONGEST
                                            : inputs->passed;
    else
        work_out(&drive->k, &drive->p);
    uint16_t behind = drive->late > OVERRUN_MAX ? OVERRUN_MAX : drive->late;
    behind = (uint16_t)(behind + passed);
    drive->late = behind > OVERRUN_EACH ? (uint16_t)(behind - OVERRUN_EACH) : 0;
    time_run(&drive->k, (float)passed * 1e-6F);
    const worked_t *k = &drive->k;
    measure(drive, k, inputs);
    watch(drive, k, inputs);
    bool asked = choose(drive, inputs->now, &target);
    feel(drive);
    decide(drive, asked, inputs->now);
    move_set_point(drive, target);
    keep(drive, target, k, inputs->now);
    bool running = drive->mode != STOPPED && !drive->parked;
    bool braking = drive->mode == STOPPING || drive->touched || target.protective;
    drive->driving = running && !braking && !drive->held;
    float v_rate = drive->v.slope, w_rate = drive->w.slope;
    if (running && braking) { /* feeds its rate forward */
        v_rate = (drive->v.speed - v.speed) * k->per_run;
        w_rate = (drive->w.speed - w.speed) * k->per_run;
    }
    float battery = fmaxf(drive->battery, MIN_BATTERY), per_battery = drive->per_battery;
    for (uint8_t i = 0; i < 2; i++) {
        float half = (i ? 0.5F : -0.5F) * drive->p.track;
        drive->duty[i] = 0.0F;
        if (running) {
            float speed = drive->v.speed + half * drive->w.speed, rate = v_rate + half * w_rate;
            float volts = control_wheel(&drive->wheels[i], &drive->p, k, speed, rate, battery,
                                        drive->held);
            drive->duty[i] = clamp(volts * per_battery, -drive->p.duty_limit, drive->p.duty_limit);
        } else if (!drive->parked) {
            if (drive->running) /* just cut: the brakes need their time */
                excuse_wheel(&drive->wheels[i]);
            release_wheel(&drive->wheels[i]);
        }
        outputs->duty[i] = drive->duty[i];
    }
    if (!running) /* where it was held, what it needs is known */
        drive->open_at = inputs->now - (drive->parked && drive->learned ? TAKE_OVER : 0U);
    drive->running = running;
    outputs->enable = brake_by_motors(drive) || running;
    /* Brakes that slip close all the same, and the motors hold against what they do not. */
    outputs->release = running && !(drive->faults & BRAKE && drive->held);
    if (outputs->release || inputs->switches & FREEWHEEL) {
        drive->shut = false;
    } else if (!drive->shut && !running && wheels_rest(drive)) {
        drive->shut = true;
        for (uint8_t i = 0; i < 2; i++)
            drive->wheels[i].home = drive->wheels[i].counts;
    }
}

answered_t drive_heed(drive_t *drive, const uint8_t *body, uint8_t size, uint32_t now,
                      uint8_t *answer, bool *save)
{
    const uint8_t kind = body[1], *payload = body + HEAD_SIZE;
    uint8_t length = (uint8_t)(size - HEAD_SIZE), status = UNKNOWN;
    if (kind == COMMAND && length == sizeof(command_t)) {
        uint8_t flags = drive->command.flags;
        memcpy(&drive->command, payload, sizeof(command_t));
        if ((flags ^ drive->command.flags) & ASSISTED) /* somebody else drives from here on */
            drive->host_free = drive->joystick.free = false;
        drive->echo = body[2];
        drive->command_at = now;
        drive->commanded = true;
        return (answered_t){0, 0};
    }
    if (kind == REARM && length == sizeof(rearm_t)) {
        rearm_t seen;
        memcpy(&seen, payload, sizeof seen);
        bool zero = command_fresh(drive, now) && drive->command.v == 0 && drive->command.w == 0;
        status = rearm(drive, seen.faults, zero, now);
        if (status == DONE && drive->manual && drive_at_rest(drive) &&
            !joystick_fresh(&drive->joystick, now)) {
            drive->manual = false; /* a person at the host takes over from a dead joystick */
            drive->host_free = zero;
        }
    }
    bool at_rest = drive->mode == STOPPED && drive_at_rest(drive);
    return heed(&drive->parameters, body, size, at_rest, status, answer, save);
}

/* A value in so many steps a unit, rounded, held at the ends of its type. */
static int16_t steps(float value, float per_unit)
{
    return (int16_t)lrintf(clamp(value * per_unit, -32767.0F, 32767.0F));
}

odometry_t drive_tell(drive_t *drive, uint32_t now, uint16_t bad, uint8_t lost)
{
    uint32_t age = now - drive->command_at;
    uint8_t pressed = drive->pressed | drive->inputs.switches;
    drive->pressed = 0;
    return (odometry_t){
        .stamp = drive->inputs.now,
        .left = drive->inputs.counts[0],
        .right = drive->inputs.counts[1],
        .speed_left = steps(drive->wheels[0].speed, 1e4F),
        .speed_right = steps(drive->wheels[1].speed, 1e4F),
        .v = steps(drive->v.speed, 1e4F),
        .w = steps(drive->w.speed, 1e4F),
        .duty_left = steps(drive->duty[0], 1e4F),
        .duty_right = steps(drive->duty[1], 1e4F),
        .battery = (uint16_t)lrintf(clamp(drive->battery * 1e3F, 0.0F, 65535.0F)),
        .mode = drive->mode == STOPPED && drive->armed ? READY : drive->mode,
        .faults = drive->faults,
        .switches = pressed,
        .echo = drive->echo,
        .age = drive->commanded && age < 255 ? (uint8_t)age : 255,
        .bad = bad,
        .lost = lost,
    };
}

joystick_told_t drive_tell_joystick(const drive_t *drive, uint32_t now)
{
    const joystick_t *stick = &drive->joystick;
    uint32_t age = now - stick->at;
    return (joystick_told_t){
        .forward = steps(stick->ahead, 1e4F),
        .left = steps(stick->aside, 1e4F),
        .flags = (uint8_t)((joystick_fresh(stick, now) ? FRESH : 0) | (stick->held ? HELD : 0) |
                           (stick->free ? 0 : MUST_CENTRE)),
        .age = stick->heard && age < 255 ? (uint8_t)age : 255,
    };
}
