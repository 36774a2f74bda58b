/* Measuring a board: how long interrupts wait, and when a pin changes. */
#include <simavr/sim_interrupts.h>

#include "emulator.h"

static void pending(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq;
    vector_t *vector = given;
    if (value && !vector->pending)
        vector->since = vector->board->avr->cycle;
    vector->pending = value; /* it is taken back where another run of the handler dealt with it */
}

static void served(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq;
    vector_t *vector = given;
    if (!value || !vector->pending)
        return;
    uint64_t waited = vector->board->avr->cycle - vector->since;
    if (waited > vector->worst)
        vector->worst = (uint32_t)waited;
    vector->count++;
    vector->pending = false;
}

static void beat(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq, (void)value;
    board_t *board = given;
    board->beats[board->beat_count++ % BEATS] = board->avr->cycle;
}

EXPORT void board_watch(board_t *board, uint8_t vector)
{
    avr_irq_t *irq = avr_get_interrupt_irq(board->avr, vector);
    board->vectors[vector].board = board;
    avr_irq_register_notify(irq + AVR_INT_IRQ_PENDING, pending, &board->vectors[vector]);
    avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, served, &board->vectors[vector]);
}
EXPORT uint32_t board_waited(const board_t *board, uint8_t vector, uint32_t *count)
{
    *count = board->vectors[vector].count;
    return board->vectors[vector].worst;
}

/* Note when a pin changes; the cycles of the last changes. */
EXPORT void board_note(board_t *board, char port, uint8_t bit)
{
    avr_irq_register_notify(board->pins[port - 'A'][bit], beat, board);
}
EXPORT uint32_t board_notes(board_t *board, uint64_t *cycles, uint32_t room)
{
    uint32_t count = board->beat_count < BEATS ? board->beat_count : BEATS;
    count = count < room ? count : room;
    for (uint32_t i = 0; i < count; i++)
        cycles[i] = board->beats[(board->beat_count - count + i) % BEATS];
    board->beat_count = 0;
    return count;
}
