#include "board.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <stddef.h>
#include <util/atomic.h>

#include "frame.h"

#ifdef USART0_RX_vect
#define RX_VECTOR USART0_RX_vect
#define UDRE_VECTOR USART0_UDRE_vect
#else
#define RX_VECTOR USART_RX_vect
#define UDRE_VECTOR USART_UDRE_vect
#endif

#define RX_SIZE 128 /* a power of two */
#define TX_SIZE 256 /* as many as a byte counts */
#define TX_REPORTS (2 * (ENCODED_MAX + 1)) /* of them that answers leave to reports */
#define RECEIVE_MAX 32 /* bytes a call: less than comes in while a frame is dealt with */
#define TICK_TOP (F_CPU / 128 / 1000 - 1) /* 1 kHz, exact */
#define UBRR_VALUE (F_CPU / 8 / BAUD - 1) /* double speed */

_Static_assert(F_CPU % (8 * BAUD) == 0, "the baud rate is not exact at this clock");
_Static_assert(F_CPU % 128000 == 0, "the tick is not exact at this clock");

static volatile uint8_t rx[RX_SIZE], rx_head, rx_tail;
static volatile uint8_t tx[TX_SIZE], tx_head, tx_tail;
static volatile uint8_t lost;
static volatile uint32_t ticks;
static receiver_t receiver;
static uint8_t sequence;

static uint8_t image[STORE_MAX];
static uint8_t to_write, written;

/* The watchdog timer stays on after it has reset the board: switch it off before anything else. */
static uint8_t cause __attribute__((section(".noinit")));
void keep_cause(void) __attribute__((naked, used, section(".init3")));
void keep_cause(void)
{
    cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

ISR(TIMER2_COMPA_vect) { ticks++; }

ISR(RX_VECTOR)
{
    uint8_t status = UCSR0A, byte = UDR0;
    uint8_t next = (uint8_t)((rx_head + 1) & (RX_SIZE - 1));
    if (next == rx_tail || status & _BV(DOR0)) {
        lost++;
        if (next == rx_tail)
            return;
    }
    rx[rx_head] = byte;
    rx_head = next;
}

ISR(UDRE_VECTOR)
{
    if (tx_head == tx_tail)
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    else
        UDR0 = tx[tx_tail++];
}

uint32_t board_now(void)
{
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = ticks; }
    return now;
}

uint16_t board_micros(void)
{
    uint16_t micros;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        uint8_t part = TCNT2;
        uint16_t whole = (uint16_t)ticks;
        if (TIFR2 & _BV(OCF2A) && part < TICK_TOP / 2)
            whole++; /* its interrupt waits */
        micros = (uint16_t)(whole * 1000U + part * (128000000UL / F_CPU));
    }
    return micros;
}

uint8_t board_lost(void) { return lost; }
uint16_t board_bad(void) { return receiver.bad; }

uint8_t board_receive(const uint8_t **body)
{
    for (uint8_t taken = 0; taken < RECEIVE_MAX && rx_tail != rx_head; taken++) {
        uint8_t size = receive(&receiver, rx[rx_tail]);
        rx_tail = (uint8_t)((rx_tail + 1) & (RX_SIZE - 1));
        if (size) {
            *body = receiver.body;
            return size;
        }
    }
    return 0;
}

/* Send a frame if there is room for it, and then for `spare` bytes more. */
static void send(uint8_t kind, const void *payload, uint8_t length, uint8_t spare)
{
    uint8_t out[ENCODED_MAX + 1];
    uint8_t size = frame(kind, sequence++, payload, length, out);
    uint8_t room = (uint8_t)(tx_tail - tx_head - 1);
    if (room < size + spare) { /* drop the whole frame, never wait */
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { lost++; }
        return;
    }
    for (uint8_t i = 0; i < size; i++)
        tx[tx_head++] = out[i];
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { UCSR0B |= _BV(UDRIE0); }
}

void board_send(uint8_t kind, const void *payload, uint8_t length)
{
    send(kind, payload, length, 0);
}

void board_answer(answered_t answered, uint8_t *answer)
{
    if (answered.kind == IDENTITY)
        answer[offsetof(identity_t, cause)] = cause;
    if (answered.kind)
        send(answered.kind, answer, answered.size, TX_REPORTS);
}

void board_identify(const parameters_t *parameters)
{
    identity_t identity = {parameters->board, parameters->count, cause, parameters->stored};
    board_send(IDENTITY, &identity, sizeof identity);
}

bool board_save(parameters_t *parameters)
{
    if (to_write)
        return false;
    parameters->stored = false;
    store_parameters(parameters, image);
    to_write = STORE_SIZE(parameters->count);
    return true;
}

void board_save_on(parameters_t *parameters)
{
    if (!to_write || !eeprom_is_ready())
        return;
    if (written < to_write) {
        eeprom_update_byte((uint8_t *)(uint16_t)written, image[written]);
        written++;
        return;
    }
    parameters->stored = true;
    for (uint8_t i = 0; i < to_write; i++)
        if (eeprom_read_byte((const uint8_t *)(uint16_t)i) != image[i])
            parameters->stored = false;
    to_write = written = 0;
}

void board_sleep(uint32_t seen)
{
    cli();
    while (rx_tail == rx_head && ticks == seen) {
        SMCR = _BV(SE); /* idle: timers and serial lines go on */
        sei();          /* the instruction after it runs before any interrupt */
        sleep_cpu();
        __asm__ volatile("nop"); /* the emulator wakes an instruction before the interrupt */
        cli();
    }
    SMCR = 0;
    sei();
}

void board_begin(parameters_t *parameters)
{
    TCCR2A = _BV(WGM21); /* clear on compare; prescaler 128 */
    OCR2A = TICK_TOP;
    TCCR2B = _BV(CS22) | _BV(CS20);
    TIMSK2 = _BV(OCIE2A);
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = UBRR_VALUE; /* last: the emulator works out the time of a byte here */
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    eeprom_read_block(image, 0, STORE_SIZE(parameters->count));
    restore_parameters(parameters, image);
    wdt_enable(WDTO_60MS);
    sei();
}
