/* The drive board's mind: who drives, what is wrong, what the motors get. Knows no registers. */
#ifndef DRIVE_H
#define DRIVE_H

#include "control.h"
#include "joystick.h"
#include "parameters.h"

typedef struct {
    uint32_t now;      /* ms since reset */
    uint16_t passed;   /* us since the last step, as it was when the counts were read */
    int32_t counts[2]; /* left, right */
    uint8_t illegal;   /* encoder steps that cannot be, a running count */
    uint8_t switches;  /* SWITCHES */
    float battery;     /* V, as converted */
} inputs_t;

typedef struct {
    float duty[2]; /* -1 to 1 of the battery's voltage */
    bool enable;   /* of both drivers and of the relay that connects them; off, it shorts the motors */
    bool release;  /* the spring brakes are held off */
} outputs_t;

typedef struct {
    drive_values_t p;
    parameters_t parameters;
    joystick_t joystick;

    uint8_t mode;
    uint16_t faults;
    bool armed;       /* no fault since a person re-armed */
    bool manual;      /* the joystick has it */
    bool running;     /* the drivers were on in the last run */
    bool driving;     /* and neither braking hard nor holding */
    bool held;        /* at rest under control: where each wheel is, it stays */
    bool parked;      /* at rest for a while: drivers off, brakes on, as when stopped */
    bool learned;     /* parked, and what holds it on its slope is known */
    bool wants;       /* asked to move, and holds until its motors bear it */
    uint8_t strips;   /* that were pressed in the last run */
    bool touched;     /* one more since it was last at rest: it stops first */
    uint32_t open_at; /* ms, when the brakes were last closed */
    bool shut;        /* at rest behind closed brakes */
    uint8_t slips;    /* of closed brakes, since a person re-armed or for a minute */
    uint32_t slipped_at; /* ms, the last */
    uint8_t span;     /* runs of this span of the look-out for runaways */
    bool host_free;   /* by the interlock: the host may move the chair; its neutral is a zero */
    bool was_held;    /* the joystick's switch, in the last run of a person who drives by it */
    uint32_t valid_at; /* ms, when someone last drove */
    uint32_t moved_at; /* ms, when the set point was last away from zero */
    uint32_t held_at;  /* ms, when it came to rest */

    worked_t k;        /* out of the parameters, as they were after the last run */
    uint16_t late;     /* us that runs are behind */

    command_t command;
    uint8_t echo;      /* its sequence */
    bool commanded;    /* there was one */
    uint32_t command_at;

    axis_t v, w;       /* set point */
    wheel_t wheels[2];
    float duty[2];
    float slowest;     /* m/s of the faster wheel, at the least since the lever was lifted */
    bool pushed;       /* faster than that by far: by hand, or by a driver that does not brake */
    float battery;     /* V, low-passed */
    float per_battery; /* 1/V, after the last run */
    uint32_t low_at;   /* ms, when the battery was last well */
    uint8_t illegal;   /* at the last look */
    uint32_t look_at;
    inputs_t inputs;   /* of the last step */
    uint8_t pressed;   /* any switch since the last odometry */
    bool begun;
} drive_t;

void drive_begin(drive_t *drive);

/* EEPROM was read: `stored` of the parameters says whether they are its. */
void drive_restored(drive_t *drive);

/* One run of the control, every 5 ms; it is right for the time that has passed, and where runs come
 * late, by more than OVERRUN_MAX in all, that is a fault. */
void drive_step(drive_t *drive, const inputs_t *inputs, outputs_t *outputs);

/* After each run, when motors and host have got what they wait for: whether a wheel turns faster than
 * its aim or away from it, whoever drives and if nobody does, and not as its voltage says. What is
 * found counts from the next run on. */
void drive_look(drive_t *drive);

/* Heed a message (head and payload). The answer's payload goes to `answer` (PAYLOAD_MAX); returns
 * the answer's kind and its size, kind 0 for none. `save` is set when EEPROM is to be written. */
answered_t drive_heed(drive_t *drive, const uint8_t *body, uint8_t size, uint32_t now,
                      uint8_t *answer, bool *save);

/* The odometry; what was pressed is told once. */
odometry_t drive_tell(drive_t *drive, uint32_t now, uint16_t bad, uint8_t lost);

/* The joystick as the host is told of it. */
joystick_told_t drive_tell_joystick(const drive_t *drive, uint32_t now);

bool drive_at_rest(const drive_t *drive);

#endif
