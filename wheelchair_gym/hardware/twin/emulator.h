/* A board on simavr: what its parts share. */
#ifndef EMULATOR_H
#define EMULATOR_H

#include <simavr/avr_ioport.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_irq.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define EXPORT __attribute__((visibility("default")))
#define PORTS 12 /* A to L */
#define SONARS 8
#define VECTORS 64
#define BEATS 4096

typedef struct {
    uint64_t at, order;
    uint8_t port, bit, level;
} edge_t;

typedef struct {
    uint8_t *bytes;
    uint32_t room, first, count;
} queue_t;

typedef struct {
    struct board *board;
    queue_t queue;
    avr_irq_t *input;
    uint32_t cycles; /* of a byte */
    bool going;
} line_t;

typedef struct {
    struct board *board;
    uint8_t which;
    char trigger_port, echo_port; /* pulse model; 0 for I2C */
    uint8_t trigger_bit, echo_bit;
    uint8_t address;           /* I2C model */
    uint64_t rose, ready;
    bool sounding, high;
    uint32_t length;           /* of the echo's pulse, us */
    uint16_t result;
    uint8_t at_register, bytes;
} sonar_t;

typedef struct {
    struct board *board;
    uint64_t since;
    uint32_t worst, count;
    bool pending;
} vector_t;

typedef struct board {
    avr_t *avr;
    line_t lines[2];
    queue_t out;
    avr_irq_t *pins[PORTS][8], *adc, *twi;
    uint8_t driven[PORTS], levels[PORTS];
    edge_t *edges; /* a heap, the earliest first */
    uint32_t edge_count, edge_room;
    uint64_t edge_order;
    sonar_t sonars[SONARS];
    uint8_t sonar_count;
    int32_t (*ping)(uint8_t which, uint64_t cycle);
    sonar_t *addressed;
    vector_t vectors[VECTORS];
    uint64_t beats[BEATS];
    uint32_t beat_count, resets, overruns;
    uint32_t hung_at; /* address in flash of the loop put there */
    uint8_t hung[2];  /* and what stood there */
    bool hanging;
} board_t;

static inline uint64_t cycles_of(const board_t *board, uint64_t us)
{
    return us * (board->avr->frequency / 1000000);
}

/* Drive a pin from outside. */
void set_pin(board_t *board, char port, uint8_t bit, uint8_t level);

/* Drive again, after a reset, what was driven before it. */
void restore_pins(board_t *board);

/* Listen to the I2C bus, if there is one. */
void wire_bus(board_t *board);

/* Forget echoes under way. */
void hush_sonars(board_t *board);

#endif
