/* Pins driven from outside: at once, or at exact cycles as an encoder's. */
#include <simavr/sim_cycle_timers.h>
#include <stdlib.h>

#include "emulator.h"

/* A driven pin is declared to its port, or the next write of PORT or DDR would raise it to
 * its pull-up's level. */

static void declare(board_t *board, uint8_t p)
{
    avr_ioport_external_t external = {
        .name = 'A' + p, .mask = board->driven[p], .value = board->levels[p]};
    avr_ioctl(board->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('A' + p), &external);
}

void set_pin(board_t *board, char port, uint8_t bit, uint8_t level)
{
    uint8_t p = (uint8_t)(port - 'A'), mask = (uint8_t)(1 << bit);
    uint8_t levels = level ? board->levels[p] | mask : board->levels[p] & (uint8_t)~mask;
    if (!(board->driven[p] & mask) || levels != board->levels[p]) {
        board->driven[p] |= mask;
        board->levels[p] = levels;
        declare(board, p);
    }
    if ((board->pins[p][bit]->value & 1) != level)
        avr_raise_irq(board->pins[p][bit], level);
}

static bool sooner(const edge_t *a, const edge_t *b)
{
    return a->at < b->at || (a->at == b->at && a->order < b->order);
}

static void add_edge(board_t *board, edge_t edge)
{
    if (board->edge_count == board->edge_room) {
        board->edge_room = board->edge_room ? 2 * board->edge_room : 256;
        board->edges = realloc(board->edges, board->edge_room * sizeof(edge_t));
    }
    edge.order = board->edge_order++;
    uint32_t i = board->edge_count++;
    for (; i && sooner(&edge, &board->edges[(i - 1) / 2]); i = (i - 1) / 2)
        board->edges[i] = board->edges[(i - 1) / 2];
    board->edges[i] = edge;
}

static edge_t next_edge(board_t *board)
{
    edge_t first = board->edges[0], last = board->edges[--board->edge_count];
    uint32_t i = 0, child;
    while ((child = 2 * i + 1) < board->edge_count) {
        if (child + 1 < board->edge_count && sooner(&board->edges[child + 1], &board->edges[child]))
            child++;
        if (!sooner(&board->edges[child], &last))
            break;
        board->edges[i] = board->edges[child];
        i = child;
    }
    board->edges[i] = last;
    return first;
}

static avr_cycle_count_t play(avr_t *avr, avr_cycle_count_t when, void *given)
{
    (void)when;
    board_t *board = given;
    while (board->edge_count && board->edges[0].at <= avr->cycle) {
        edge_t edge = next_edge(board);
        set_pin(board, (char)edge.port, edge.bit, edge.level);
    }
    return board->edge_count ? board->edges[0].at : 0;
}

static void arm_edges(board_t *board)
{
    if (board->edge_count == 0)
        return;
    uint64_t now = board->avr->cycle, at = board->edges[0].at;
    avr_cycle_timer_register(board->avr, at > now ? at - now : 1, play, board);
}

void restore_pins(board_t *board)
{
    for (uint8_t p = 0; p < PORTS; p++) {
        if (board->driven[p])
            declare(board, p);
        for (uint8_t bit = 0; bit < 8; bit++) {
            uint8_t level = board->levels[p] >> bit & 1;
            if (!(board->driven[p] >> bit & 1))
                continue;
            board->pins[p][bit]->value = !level; /* or it would pass for no change */
            avr_raise_irq(board->pins[p][bit], level);
        }
    }
    arm_edges(board);
}

EXPORT void board_pin(board_t *board, char port, uint8_t bit, uint8_t level)
{
    set_pin(board, port, bit, level);
}

/* A quadrature encoder on two neighbouring pins turns evenly from one position to another [counts]
 * until a cycle. */
EXPORT void board_turn(board_t *board, char port, uint8_t bit, double from, double to,
                       uint64_t until)
{
    static const uint8_t gray[4] = {0, 1, 3, 2};
    uint64_t now = board->avr->cycle;
    int64_t first = (int64_t)from - (from < (double)(int64_t)from);
    int64_t last = (int64_t)to - (to < (double)(int64_t)to);
    int64_t step = last > first ? 1 : -1;
    for (int64_t n = first; n != last; n += step) {
        double edge = (double)(step > 0 ? n + 1 : n);
        uint8_t old = gray[n & 3], new = gray[(n + step) & 3];
        uint8_t changed = (old ^ new) >> 1;
        uint64_t at = now + (uint64_t)((edge - from) / (to - from) * (double)(until - now));
        add_edge(board, (edge_t){at, 0, (uint8_t)port, bit + changed, (new >> changed) & 1});
    }
    arm_edges(board);
}
