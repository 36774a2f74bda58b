/* The drive board: ATmega2560 at 16 MHz. Pins as in ../README.md. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <stddef.h>
#include <util/atomic.h>

#include "board.h"
#include "drive.h"

#define CONTROL_PERIOD 5U   /* ms: RUN */
#define CATCH_UP 2U         /* ms that a late run may be nearer to the next one */
#define ODOMETRY_PERIOD 20U /* ms: 50 Hz */
#define PWM_TOP 799U        /* 20 kHz, above hearing */
#define PER_ADC (1.0F / 1023.0F) /* of its full scale */
#define SWITCH_RUNS 2       /* runs that a switch must agree before it is let go */

#define LEFT_WAY _BV(PL0) /* directions: high is backward */
#define RIGHT_WAY _BV(PL1)
#define ENABLE _BV(PL2)
#define RELEASE _BV(PL3) /* of the spring brakes */
#define BEAT _BV(PL4)    /* changes with each run of the control: for an outer watchdog */

#define IBUS_UBRR ((F_CPU + 4 * IBUS_BAUD) / (8 * IBUS_BAUD) - 1)

static drive_t drive;

/* Quadrature, all four edges, on PB0..PB3: left A, B, right A, B. */
static volatile int32_t counts[2];
static volatile uint8_t illegal, pins_before;
static const int8_t steps[16] = {0, 1, -1, 2, -1, 0, 2, 1, 1, 2, 0, -1, 2, -1, 1, 0};

ISR(PCINT0_vect)
{
    uint8_t pins = PINB & 0x0F, before = pins_before;
    pins_before = pins;
    int8_t left = steps[(uint8_t)((before & 0x03) << 2 | (pins & 0x03))];
    int8_t right = steps[(uint8_t)((before & 0x0C) | pins >> 2)];
    if (left == 2)
        illegal++;
    else if (left)
        counts[0] += left;
    if (right == 2)
        illegal++;
    else if (right)
        counts[1] += right;
}

/* The joystick's receiver: bytes wait here for the main loop. */
static volatile uint8_t stick[64], stick_head, stick_tail;

ISR(USART1_RX_vect)
{
    stick[stick_head & 63] = UDR1;
    stick_head++;
}

static void drive_motor(uint8_t right, float duty)
{
    uint8_t way = right ? RIGHT_WAY : LEFT_WAY;
    float size = duty < 0.0F ? -duty : duty;
    uint16_t on = (uint16_t)(size * (PWM_TOP + 1) + 0.5F);
    uint8_t pin = right ? _BV(COM4B1) : _BV(COM4A1);
    if (duty < 0.0F)
        PORTL |= way;
    else
        PORTL &= (uint8_t)~way;
    if (on == 0) { /* a compare value of 0 would still give a pulse of one count */
        TCCR4A &= (uint8_t)~pin;
        return;
    }
    if (right)
        OCR4B = on - 1;
    else
        OCR4A = on - 1;
    TCCR4A |= pin;
}

/* Each input is pulled to ground while all is well: by the contacts of the emergency stop, the strips
 * and the lever, by the drivers while they are ready. A broken wire reads as pressed or as a fault.
 * What is pressed counts at once, what is let go after a while. */
static uint8_t read_switches(void)
{
    static uint8_t history[SWITCH_RUNS];
    static uint8_t next;
    uint8_t now = PINC, any = now;
    history[next] = now;
    next = (uint8_t)((next + 1) % SWITCH_RUNS);
    for (uint8_t i = 0; i < SWITCH_RUNS; i++)
        any |= history[i];
    return any;
}

static void control(uint32_t now)
{
    static uint16_t before;
    inputs_t inputs = {.now = now, .switches = read_switches()};
    outputs_t outputs;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        inputs.counts[0] = counts[0];
        inputs.counts[1] = counts[1];
        inputs.illegal = illegal;
        inputs.passed = board_micros();
    }
    uint16_t at = inputs.passed;
    inputs.passed = (uint16_t)(at - before);
    before = at;
    inputs.battery = (float)ADC * PER_ADC * drive.p.battery_full;
    ADCSRA |= _BV(ADSC);
    drive_step(&drive, &inputs, &outputs);
    if (!outputs.enable)
        PORTL &= (uint8_t)~(ENABLE | RELEASE); /* before anything else */
    drive_motor(0, outputs.duty[0]);
    drive_motor(1, outputs.duty[1]);
    PORTL = (uint8_t)((PORTL & ~(ENABLE | RELEASE)) | outputs.enable * ENABLE | outputs.release * RELEASE);
    PINL = BEAT; /* toggles */
}

static void begin(void)
{
    DDRH = _BV(PH3) | _BV(PH4);
    DDRL = LEFT_WAY | RIGHT_WAY | ENABLE | RELEASE | BEAT;
    PORTB = 0x0F; /* pull-ups of the encoders */
    PORTC = 0xFF; /* and of the switches */
    ICR4 = PWM_TOP;
    TCCR4A = _BV(WGM41); /* fast PWM up to ICR4 */
    TCCR4B = _BV(WGM43) | _BV(WGM42) | _BV(CS40);
    ADMUX = _BV(REFS1) | _BV(REFS0); /* internal 2.56 V: the supply sags; channel 0 */
    ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0) | _BV(ADSC);
    UCSR1A = _BV(U2X1);
    UCSR1C = _BV(UCSZ11) | _BV(UCSZ10);
    UBRR1 = IBUS_UBRR;
    UCSR1B = _BV(RXEN1) | _BV(RXCIE1);
    while (ADCSRA & _BV(ADSC))
        ;
    pins_before = PINB & 0x0F;
    PCMSK0 = 0x0F;
    PCICR = _BV(PCIE0);
}

/* At most a frame of the host: the control goes before the next one. */
static void hear(uint32_t now)
{
    const uint8_t *body;
    uint8_t size, answer[PAYLOAD_MAX];
    if ((size = board_receive(&body)) != 0) {
        bool save = false;
        answered_t answered = drive_heed(&drive, body, size, now, answer, &save);
        if (save && !board_save(&drive.parameters))
            answer[offsetof(answer_t, status)] = BUSY;
        board_answer(answered, answer);
    }
    while (stick_tail != stick_head)
        joystick_byte(&drive.joystick, stick[stick_tail++ & 63], now);
}

int main(void)
{
    drive_begin(&drive);
    begin();
    board_begin(&drive.parameters);
    drive_restored(&drive);
    board_identify(&drive.parameters);
    uint32_t controlled = 0, told = 0;
    bool look = false;
    for (;;) {
        uint32_t now = board_now();
        hear(now);
        if (now - controlled >= CONTROL_PERIOD) {
            /* Runs that were missed are not made up for: speeds over instants are noise. */
            bool missed = now - controlled > CONTROL_PERIOD + CATCH_UP;
            controlled = missed ? now : controlled + CONTROL_PERIOD;
            control(now);
            look = true;
            board_save_on(&drive.parameters);
            wdt_reset();
        }
        if (now - told >= ODOMETRY_PERIOD) {
            told += ODOMETRY_PERIOD;
            odometry_t odometry = drive_tell(&drive, now, board_bad(), board_lost());
            board_send(ODOMETRY, &odometry, sizeof odometry);
            if (drive.joystick.heard) {
                joystick_told_t stick = drive_tell_joystick(&drive, now);
                board_send(JOYSTICK, &stick, sizeof stick);
            }
        }
        if (look) {
            drive_look(&drive);
            look = false;
        }
        board_sleep(now);
    }
}
