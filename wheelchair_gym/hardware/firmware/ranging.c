#include "ranging.h"

#include <string.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#else
#define PROGMEM
#endif

#define BOUNDS(name, initial, low, high, unit) {initial, low, high},
static const bounds_t bounds[] PROGMEM = {RANGE_PARAMETERS(BOUNDS)};
#define COUNT ((uint8_t)(sizeof bounds / sizeof bounds[0]))

static const uint8_t order[RANGERS] = FIRING_ORDER;

void ranging_begin(ranging_t *ranging)
{
    memset(ranging, 0, sizeof *ranging);
    ranging->parameters = (parameters_t){bounds, &ranging->p.interval, COUNT, RANGE_BOARD, false};
    use_defaults(&ranging->parameters);
    memset(ranging->status, UNTRIED, sizeof ranging->status);
}

bool ranging_due(ranging_t *ranging, uint32_t now)
{
    if ((int32_t)(now - ranging->due) < 0)
        return false;
    if (ranging->waiting)
        ranging_silent(ranging);
    uint16_t interval = (uint16_t)(ranging->p.interval * 1000.0F + 0.5F);
    ranging->due = now - ranging->due > interval ? now + interval : ranging->due + interval;
    do {
        ranging->firing = order[ranging->turn];
        ranging->turn = (uint8_t)((ranging->turn + 1) % RANGERS);
    } while (ranging->firing >= ranging->p.n_rangers);
    ranging->fired_at[ranging->firing] = now;
    ranging->waiting = true;
    return true;
}

void ranging_heard(ranging_t *ranging, uint32_t flight)
{
    const ranging_values_t *p = &ranging->p;
    bool narrow = ranging->firing < NARROW_RANGERS;
    float reach = narrow ? p->narrow_reach : p->wide_reach;
    float blind = narrow ? p->narrow_blind : p->wide_blind;
    float metres = (float)flight * 0.5e-6F * p->sound;
    bool echo = flight != 0 && metres <= reach;
    ranging->status[ranging->firing] = echo ? ECHO : NO_ECHO;
    if (metres < blind)
        metres = blind;
    ranging->range[ranging->firing] = echo ? (uint16_t)(metres * 1000.0F + 0.5F) : UINT16_MAX;
    ranging->waiting = false;
}

void ranging_silent(ranging_t *ranging)
{
    ranging->status[ranging->firing] = SILENT;
    ranging->range[ranging->firing] = UINT16_MAX;
    ranging->waiting = false;
}

answered_t ranging_heed(ranging_t *ranging, const uint8_t *body, uint8_t size, uint8_t *answer,
                        bool *save)
{
    return heed(&ranging->parameters, body, size, true, UNKNOWN, answer, save);
}

ranges_t ranging_tell(const ranging_t *ranging, uint32_t now, uint16_t bad)
{
    ranges_t told = {.stamp = now, .bad = bad};
    for (uint8_t i = 0; i < RANGERS; i++) {
        uint32_t age = now - ranging->fired_at[i];
        if (age > UINT16_MAX || ranging->status[i] == UNTRIED)
            age = UINT16_MAX;
        told.ranges[i] = (range_t){ranging->range[i], (uint16_t)age, ranging->status[i]};
    }
    return told;
}
