/* The boards' minds as a native library, for tests and fuzzing: no registers, the same sources. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drive.h"
#include "frame.h"
#include "ranging.h"

#define EXPORT __attribute__((visibility("default")))

/* The tables of protocol.h as text, a line each, for comparison with the host's. */
#define FIELD(type, name, unit) #type " " #name " " unit "\n"
#define NAMED(name, value) #name " " #value "\n"
#define VALUED(name, initial, low, high, unit) #name " " #initial " " #low " " #high " " unit "\n"
#define TABLE(KIND) {#KIND, KIND, KIND##_LAYOUT(FIELD) ""},

static const struct {
    const char *name;
    int kind;
    const char *text;
} tables[] = {
    MESSAGES(TABLE)
    {"Mode", 0, MODES(NAMED)},
    {"Fault", 0, FAULTS(NAMED)},
    {"Switch", 0, SWITCHES(NAMED)},
    {"RangeStatus", 0, RANGE_STATUS(NAMED)},
    {"Status", 0, STATUSES(NAMED)},
    {"Board", 0, BOARDS(NAMED)},
    {"CommandFlag", 0, COMMAND_FLAGS(NAMED)},
    {"JoystickFlag", 0, JOYSTICK_FLAGS(NAMED)},
    {"drive", 0, DRIVE_PARAMETERS(VALUED)},
    {"range", 0, RANGE_PARAMETERS(VALUED)},
};

EXPORT const char *table_name(unsigned index)
{
    return index < sizeof tables / sizeof tables[0] ? tables[index].name : NULL;
}
EXPORT int table_kind(unsigned index) { return tables[index].kind; }
EXPORT const char *table_text(unsigned index) { return tables[index].text; }
EXPORT unsigned version(void) { return PROTOCOL_VERSION; }
EXPORT unsigned baud(void) { return BAUD; }
EXPORT const uint8_t firing_order[RANGERS] = FIRING_ORDER;

EXPORT receiver_t *receiver_new(void) { return calloc(1, sizeof(receiver_t)); }
EXPORT const uint8_t *receiver_body(const receiver_t *receiver) { return receiver->body; }
EXPORT unsigned receiver_bad(const receiver_t *receiver) { return receiver->bad; }

/* Feed bytes; the bodies of good frames go to `out`, each after its length. Returns bytes written. */
EXPORT unsigned receive_all(receiver_t *receiver, const uint8_t *bytes, unsigned length,
                            uint8_t *out)
{
    unsigned written = 0;
    for (unsigned i = 0; i < length; i++) {
        uint8_t size = receive(receiver, bytes[i]);
        if (size) {
            out[written++] = size;
            memcpy(out + written, receiver->body, size);
            written += size;
        }
    }
    return written;
}

EXPORT drive_t *drive_new(void)
{
    drive_t *drive = malloc(sizeof(drive_t));
    if (drive)
        drive_begin(drive);
    return drive;
}
EXPORT void drive_run(drive_t *drive, uint32_t now, uint16_t passed, int32_t left, int32_t right,
                      uint8_t illegal, uint8_t switches, float battery, float *duty, uint8_t *pins)
{
    inputs_t inputs = {now, passed, {left, right}, illegal, switches, battery};
    outputs_t outputs;
    drive_step(drive, &inputs, &outputs);
    drive_look(drive);
    memcpy(duty, outputs.duty, sizeof outputs.duty);
    *pins = (uint8_t)(outputs.enable | outputs.release << 1);
}
/* Bytes of the host in, bytes of the board out. */
EXPORT unsigned drive_hear(drive_t *drive, receiver_t *receiver, const uint8_t *bytes,
                           unsigned length, uint32_t now, uint8_t *out)
{
    unsigned written = 0;
    uint8_t answer[PAYLOAD_MAX];
    for (unsigned i = 0; i < length; i++) {
        uint8_t size = receive(receiver, bytes[i]);
        if (size) {
            bool save = false;
            answered_t told = drive_heed(drive, receiver->body, size, now, answer, &save);
            drive->parameters.stored |= save;
            if (told.kind)
                written += frame(told.kind, 0, answer, told.size, out + written);
        }
    }
    return written;
}
EXPORT unsigned drive_say(drive_t *drive, uint32_t now, uint8_t *out)
{
    odometry_t odometry = drive_tell(drive, now, 0, 0);
    return frame(ODOMETRY, 0, &odometry, sizeof odometry, out);
}
EXPORT void drive_stick(drive_t *drive, const uint8_t *bytes, unsigned length, uint32_t now)
{
    for (unsigned i = 0; i < length; i++)
        joystick_byte(&drive->joystick, bytes[i], now);
}
EXPORT unsigned drive_say_joystick(const drive_t *drive, uint32_t now, uint8_t *out)
{
    joystick_told_t told = drive_tell_joystick(drive, now);
    return frame(JOYSTICK, 0, &told, sizeof told, out);
}
EXPORT bool drive_restore(drive_t *drive, const uint8_t *image)
{
    bool good = restore_parameters(&drive->parameters, image);
    drive_restored(drive);
    return good;
}
EXPORT void drive_store(const drive_t *drive, uint8_t *image)
{
    store_parameters(&drive->parameters, image);
}
EXPORT unsigned drive_store_size(const drive_t *drive)
{
    return STORE_SIZE(drive->parameters.count);
}

EXPORT ranging_t *ranging_new(void)
{
    ranging_t *ranging = malloc(sizeof(ranging_t));
    if (ranging)
        ranging_begin(ranging);
    return ranging;
}
/* Run for a millisecond: a ranger that fires hears `flight` [us] at once; below 0 it is silent. */
EXPORT int ranging_run(ranging_t *ranging, uint32_t now, int32_t flight)
{
    if (!ranging_due(ranging, now))
        return -1;
    if (flight < 0)
        ranging_silent(ranging);
    else
        ranging_heard(ranging, (uint32_t)flight);
    return ranging->firing;
}
EXPORT unsigned ranging_say(const ranging_t *ranging, uint32_t now, uint8_t *out)
{
    ranges_t ranges = ranging_tell(ranging, now, 0);
    return frame(RANGES, 0, &ranges, sizeof ranges, out);
}

EXPORT void free_it(void *what) { free(what); }

EXPORT unsigned frame_of(uint8_t kind, uint8_t sequence, const uint8_t *payload, uint8_t length,
                         uint8_t *out)
{
    return frame(kind, sequence, payload, length, out);
}

EXPORT void approach_all(axis_t *axis, float target, float up, float down, float jerk, float dt,
                         unsigned count, float *speeds)
{
    for (unsigned i = 0; i < count; i++) {
        approach(axis, target, up, down, jerk, dt, 1.0F / dt);
        speeds[i] = axis->speed;
    }
}
