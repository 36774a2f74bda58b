#include "joystick.h"

#include <string.h>

#define CENTRE 1500
#define SPAN 500
#define DEAD 25   /* of 500: a stick at rest is not quite at its centre */
#define HIGH 1700 /* a switch that is on */
#define SANE(value) ((value) >= 900 && (value) <= 2100)

static float stick(uint16_t value)
{
    int16_t off = (int16_t)(value - CENTRE);
    int16_t past = (int16_t)(off > DEAD ? off - DEAD : off < -DEAD ? off + DEAD : 0);
    float share = (float)past / (float)(SPAN - DEAD);
    return share > 1.0F ? 1.0F : share < -1.0F ? -1.0F : share;
}

static uint16_t channel(const joystick_t *joystick, uint8_t index)
{
    const uint8_t *low = joystick->bytes + 2 + 2 * index;
    /* Receivers carry further channels in the upper four bits. */
    return (uint16_t)((low[0] | low[1] << 8) & 0x0FFF);
}

static void accept(joystick_t *joystick, uint32_t now)
{
    uint16_t sum = 0xFFFF;
    for (uint8_t i = 0; i < IBUS_SIZE - 2; i++)
        sum = (uint16_t)(sum - joystick->bytes[i]);
    if (joystick->bytes[30] != (uint8_t)sum || joystick->bytes[31] != (uint8_t)(sum >> 8))
        return;
    for (uint8_t i = 0; i <= SWITCH_HELD; i++)
        if (!SANE(channel(joystick, i)))
            return;
    bool manual = channel(joystick, SWITCH_MANUAL) > HIGH;
    if (manual != joystick->manual || !joystick_fresh(joystick, now))
        joystick->free = false;
    joystick->ahead = stick(channel(joystick, STICK_AHEAD));
    joystick->aside = -stick(channel(joystick, STICK_ASIDE)); /* right is larger */
    joystick->manual = manual;
    joystick->held = channel(joystick, SWITCH_HELD) > HIGH;
    joystick->free = interlock(joystick->free, joystick->held, joystick_centred(joystick));
    joystick->at = now;
    joystick->heard = true;
}

void joystick_byte(joystick_t *joystick, uint8_t byte, uint32_t now)
{
    joystick->bytes[joystick->length++] = byte;
    /* A frame begins with 0x20 0x40; what does not is dropped until it may. */
    while (joystick->length && (joystick->bytes[0] != 0x20 ||
                                (joystick->length > 1 && joystick->bytes[1] != 0x40)))
        memmove(joystick->bytes, joystick->bytes + 1, --joystick->length);
    if (joystick->length == IBUS_SIZE) {
        accept(joystick, now);
        joystick->length = 0;
    }
}

bool joystick_fresh(const joystick_t *joystick, uint32_t now)
{
    return joystick->heard && now - joystick->at < JOYSTICK_TIMEOUT;
}

bool joystick_centred(const joystick_t *joystick)
{
    return joystick->ahead == 0.0F && joystick->aside == 0.0F;
}
