/* The range board: ATmega328P at 16 MHz. Pins as in ../README.md. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <stddef.h>
#include <util/atomic.h>
#include <util/delay.h>
#include <util/twi.h>

#include "board.h"
#include "ranging.h"

#define MICROSECONDS 4U /* a count of timer 1: 16 bits last for 262 ms, an echo for 38 */
#define TRIGGER 10      /* us, at least */

/* SRF08: addresses 0xE0, 0xE2, 0xE4, ... 0xEA; registers. */
#define ADDRESS 0xE0
#define COMMAND_REGISTER 0
#define GAIN_REGISTER 1
#define ECHO_REGISTER 2
#define RANGE_IN_US 0x52
#define GAIN 0x10  /* of 31: higher ones hear echoes of the shot before */
#define WINDOW 140 /* (6 m + 43 mm) / 43 mm */
#define BUS_DEADLINE 49U /* ms after firing: before the next one, which comes after 50 or more */
#define TWI_RATE 100000UL
#define SDA _BV(PC4)
#define SCL _BV(PC5)
#define HALF_CLOCK 5 /* us */
#define CLOCKS 9     /* of a byte and its acknowledgement */

static ranging_t ranging;

/* Pulse model: the echo lines are PB0..PB3. */
static volatile uint16_t rose, fell;
static volatile uint8_t edges, line;

ISR(PCINT0_vect)
{
    uint16_t at = TCNT1;
    uint8_t high = PINB & line;
    if (high && edges == 0) {
        rose = at;
        edges = 1;
    } else if (!high && edges == 1) {
        fell = at;
        edges = 2;
    }
}

/* I2C: one transaction at a time, driven by its interrupt: bytes out, then bytes in. */
enum { IDLE, GOING, DONE_WELL, FAILED };
static volatile uint8_t bus = IDLE;
static uint8_t slave, outgoing[4], incoming[2];
static volatile uint8_t to_send, sent, to_read, got;

#define GO(bits) (TWCR = (uint8_t)(_BV(TWINT) | _BV(TWEN) | _BV(TWIE) | (bits)))

static void finish(uint8_t how)
{
    bus = how;
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
}

ISR(TWI_vect)
{
    switch (TW_STATUS) {
    case TW_START:
        TWDR = slave;
        GO(0);
        break;
    case TW_REP_START:
        TWDR = slave | TW_READ;
        GO(0);
        break;
    case TW_MT_SLA_ACK:
    case TW_MT_DATA_ACK: /* the emulator says this after the address, too */
        if (sent < to_send) {
            TWDR = outgoing[sent++];
            GO(0);
        } else if (to_read) {
            GO(_BV(TWSTA));
        } else {
            finish(DONE_WELL);
        }
        break;
    case TW_MR_SLA_ACK:
        GO(to_read > 1 ? _BV(TWEA) : 0);
        break;
    case TW_MR_DATA_ACK:
    case TW_MR_DATA_NACK:
        incoming[got++] = TWDR;
        if (got == to_read)
            finish(DONE_WELL);
        else
            GO(got + 1 < to_read ? _BV(TWEA) : 0);
        break;
    default:
        finish(FAILED);
    }
}

static void pull(uint8_t lines)
{
    PORTC &= (uint8_t)~lines;
    DDRC |= lines;
    _delay_us(HALF_CLOCK);
}

static void let_go(uint8_t lines)
{
    DDRC &= (uint8_t)~lines;
    PORTC |= lines; /* pull-ups */
    _delay_us(HALF_CLOCK);
}

/* A ranger that was interrupted amid a byte holds SDA low for good. Clocks let it end its byte, which
 * nobody acknowledges, and a STOP ends the rest (I2C specification UM10204, 3.1.16). 110 us at most. */
static void free_bus(void)
{
    TWCR = 0; /* the lines are the port's */
    for (uint8_t i = 0; i < CLOCKS && !(PINC & SDA); i++) {
        pull(SCL);
        let_go(SCL);
    }
    pull(SCL);
    pull(SDA);
    let_go(SCL);
    let_go(SDA);
}

static void transact(uint8_t ranger, uint8_t sending, uint8_t reading)
{
    slave = (uint8_t)(ADDRESS + 2 * (ranger - NARROW_RANGERS));
    to_send = sending;
    to_read = reading;
    sent = got = 0;
    bus = GOING;
    GO(_BV(TWSTA));
}

/* What the firing ranger is doing. */
static enum { RESTING, LISTENING, SETTING, STARTING, WAITING, READING } phase;

static void fire(void)
{
    uint8_t ranger = ranging.firing;
    if (ranger >= NARROW_RANGERS) {
        outgoing[0] = GAIN_REGISTER; /* anew each time: it may have been without power */
        outgoing[1] = GAIN;
        outgoing[2] = WINDOW;
        transact(ranger, 3, 0);
        phase = SETTING;
        return;
    }
    uint8_t trigger = (uint8_t)(_BV(PD4) << ranger);
    line = (uint8_t)_BV(ranger);
    if (PINB & line) { /* still high from before, or stuck */
        ranging_silent(&ranging);
        phase = RESTING;
        return;
    }
    edges = 0;
    PCMSK0 = line;
    PORTD |= trigger;
    _delay_us(TRIGGER + 2);
    PORTD &= (uint8_t)~trigger;
    phase = LISTENING;
}

static void listen(uint16_t since)
{
    uint8_t seen = edges;
    if (seen < 2 && since < PULSE_DEADLINE)
        return;
    phase = RESTING;
    PCMSK0 = 0;
    if (seen == 2)
        ranging_heard(&ranging, (uint32_t)(uint16_t)(fell - rose) * MICROSECONDS);
    else
        ranging_silent(&ranging); /* never rose, or never fell */
}

static void converse(uint16_t since)
{
    if (bus == GOING && since >= BUS_DEADLINE)
        TWCR = 0, bus = FAILED; /* somebody holds the bus: begin anew next time */
    if (bus == FAILED) {
        if (!(PINC & SDA))
            free_bus();
        phase = RESTING;
        ranging_silent(&ranging);
    } else if (phase == SETTING && bus == DONE_WELL) {
        outgoing[0] = COMMAND_REGISTER;
        outgoing[1] = RANGE_IN_US;
        transact(ranging.firing, 2, 0);
        phase = STARTING;
    } else if (phase == STARTING && bus == DONE_WELL) {
        phase = WAITING;
    } else if (phase == WAITING && since >= I2C_DEADLINE) {
        outgoing[0] = ECHO_REGISTER;
        transact(ranging.firing, 1, 2);
        phase = READING;
    } else if (phase == READING && bus == DONE_WELL) {
        phase = RESTING;
        ranging_heard(&ranging, (uint32_t)(incoming[0] << 8 | incoming[1]) & 0xFFFF);
    }
}

static void tell(uint32_t now)
{
    ranges_t told = ranging_tell(&ranging, now, board_bad());
    board_send(RANGES, &told, sizeof told);
}

/* At most a frame of the host: the rangers go before the next one. */
static void hear(void)
{
    const uint8_t *body;
    uint8_t size, answer[PAYLOAD_MAX];
    if ((size = board_receive(&body)) != 0) {
        bool save = false;
        answered_t answered = ranging_heed(&ranging, body, size, answer, &save);
        if (save && !board_save(&ranging.parameters))
            answer[offsetof(answer_t, status)] = BUSY;
        board_answer(answered, answer);
    }
}

int main(void)
{
    ranging_begin(&ranging);
    DDRD = _BV(PD4) | _BV(PD5) | _BV(PD6) | _BV(PD7); /* triggers */
    PORTB = 0x0F; /* pull-ups of the echo lines: one without a sensor reads as silent */
    PORTC = SDA | SCL; /* weak pull-ups of the bus */
    TCCR1A = 0;
    TCCR1B = _BV(CS11) | _BV(CS10); /* prescaler 64: 4 us */
    TWBR = (F_CPU / TWI_RATE - 16) / 2;
    PCICR = _BV(PCIE0);
    board_begin(&ranging.parameters);
    board_identify(&ranging.parameters);
    uint32_t seen = 0;
    for (;;) {
        uint32_t now = board_now();
        hear();
        if (now != seen) {
            seen = now;
            wdt_reset();
            board_save_on(&ranging.parameters);
            uint16_t since = (uint16_t)(now - ranging.fired_at[ranging.firing]);
            bool was_busy = phase != RESTING;
            if (phase == LISTENING)
                listen(since);
            else if (phase != RESTING)
                converse(since);
            if (ranging_due(&ranging, now)) {
                fire();
                was_busy = phase != RESTING || was_busy;
            }
            if (was_busy && phase == RESTING)
                tell(now);
        }
        board_sleep(now);
    }
}
