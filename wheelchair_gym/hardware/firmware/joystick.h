/* The joystick's receiver at the drive board: FlySky iBUS, 115200 baud, a frame every 7.7 ms. */
#ifndef JOYSTICK_H
#define JOYSTICK_H

#include <stdbool.h>
#include <stdint.h>

#define IBUS_BAUD 115200UL
#define IBUS_SIZE 32 /* 0x20 0x40, 14 channels of 1000 to 2000, 0xFFFF minus the sum of all before */
#define JOYSTICK_TIMEOUT 200U /* ms without a frame: gone */

enum { STICK_ASIDE = 0, STICK_AHEAD = 1, SWITCH_MANUAL = 4, SWITCH_HELD = 5 }; /* channels */

typedef struct {
    uint8_t bytes[IBUS_SIZE];
    uint8_t length;
    bool heard;   /* a frame since reset */
    uint32_t at;  /* ms, of the last good frame */
    float ahead;  /* -1 to 1 */
    float aside;  /* -1 to 1, left positive */
    bool manual;  /* the person takes over */
    bool held;    /* the switch that must be held to drive; let go and back, it re-arms */
    bool free;    /* by the interlock: while it is heard, it may move the chair */
} joystick_t;

/* The interlock of everybody who drives: nothing moves before neutral was seen with the enable held,
 * and without a break since then. Returns whether motion is free now; `free`: whether it was.
 * A take-over, a re-arm and silence begin anew, with false. */
static inline bool interlock(bool free, bool enabled, bool neutral)
{
    return enabled && (free || neutral);
}

void joystick_byte(joystick_t *joystick, uint8_t byte, uint32_t now);
bool joystick_fresh(const joystick_t *joystick, uint32_t now);
bool joystick_centred(const joystick_t *joystick);

#endif
