/* The range board's mind: who fires when, and what an echo means. Knows no registers. */
#ifndef RANGING_H
#define RANGING_H

#include "parameters.h"

#define VALUE_OF_RANGING(name, initial, low, high, unit) float name;
typedef struct { RANGE_PARAMETERS(VALUE_OF_RANGING) } ranging_values_t;

#define PULSE_DEADLINE 46U /* ms after firing: an HC-SR04 ends a pulse without echo after 38 ms */
#define I2C_DEADLINE 45U   /* ms: an SRF08 set to 6 m listens for 36 ms */

typedef struct {
    ranging_values_t p;
    parameters_t parameters;
    uint16_t range[RANGERS]; /* mm */
    uint8_t status[RANGERS];
    uint32_t fired_at[RANGERS]; /* ms */
    uint8_t turn;     /* into the order of firing */
    uint8_t firing;   /* who was fired last */
    bool waiting;     /* for its echo */
    uint32_t due;     /* ms, of the next firing */
} ranging_t;

void ranging_begin(ranging_t *ranging);

/* Whether somebody is to fire now: `firing` says who. */
bool ranging_due(ranging_t *ranging, uint32_t now);

/* What came of it: the time of flight there and back [us]; 0 for no echo, or nothing at all. */
void ranging_heard(ranging_t *ranging, uint32_t flight);
void ranging_silent(ranging_t *ranging);

/* Heed a message, as drive_heed does. */
answered_t ranging_heed(ranging_t *ranging, const uint8_t *body, uint8_t size, uint8_t *answer,
                        bool *save);

ranges_t ranging_tell(const ranging_t *ranging, uint32_t now, uint16_t bad);

#endif
