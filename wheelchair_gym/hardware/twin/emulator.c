/* A board on simavr, run to an exact cycle: pins, serial lines, ADC, EEPROM, two models of sonar.
 *
 * Links simavr, which is GPL-3: a tool built by its user, no part of the program that drives.
 * What is peculiar to simavr 1.6 is said where it is dealt with.
 */
#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "emulator.h"

#define BITS_PER_BYTE 11 /* on simavr's receiver, whatever the format is */

static board_t *running; /* whose overruns the log speaks of */

static void listen(avr_t *avr, const int level, const char *format, va_list values)
{
    (void)avr, (void)level, (void)values;
    if (running && strstr(format, "overrun"))
        running->overruns++;
}

static void never_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }

static void push(queue_t *queue, uint8_t byte)
{
    if (queue->count == queue->room) {
        uint32_t room = queue->room ? 2 * queue->room : 4096;
        uint8_t *bytes = malloc(room);
        for (uint32_t i = 0; i < queue->count; i++)
            bytes[i] = queue->bytes[(queue->first + i) % queue->room];
        free(queue->bytes);
        *queue = (queue_t){bytes, room, 0, queue->count};
    }
    queue->bytes[(queue->first + queue->count++) % queue->room] = byte;
}

static uint8_t pull(queue_t *queue)
{
    uint8_t byte = queue->bytes[queue->first];
    queue->first = (queue->first + 1) % queue->room;
    queue->count--;
    return byte;
}

/* Serial lines: bytes come at the rate of the wire. */

static avr_cycle_count_t deliver(avr_t *avr, avr_cycle_count_t when, void *given)
{
    (void)avr;
    line_t *line = given;
    if (line->queue.count == 0) {
        line->going = false;
        return 0;
    }
    avr_raise_irq(line->input, pull(&line->queue));
    return when + line->cycles;
}

static void said(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq;
    push(&((board_t *)given)->out, (uint8_t)value);
}

/* A reset wipes all timers, what drives the pins, and the cycle limit, back to one instruction. */
static void after_reset(board_t *board)
{
    uint32_t flags = 0; /* neither echo to a terminal nor sleep in wall time */
    board->resets++;
    board->avr->run_cycle_limit = board->avr->frequency;
    for (uint8_t i = 0; i < 2; i++) {
        line_t *line = &board->lines[i];
        line->queue.count = 0;
        line->going = false;
        if (line->input)
            avr_ioctl(board->avr, AVR_IOCTL_UART_SET_FLAGS((char)('0' + i)), &flags);
    }
    hush_sonars(board);
    restore_pins(board);
    for (uint8_t i = 0; i < VECTORS; i++)
        board->vectors[i].pending = false;
    if (board->hanging)
        memcpy(board->avr->flash + board->hung_at, board->hung, 2);
    board->hanging = false;
}

EXPORT board_t *board_new(const char *mcu, const char *elf, uint32_t frequency,
                          const uint32_t *bauds)
{
    avr_global_logger_set(listen);
    avr_t *avr = avr_make_mcu_by_name(mcu);
    elf_firmware_t firmware = {0};
    if (!avr || avr_init(avr) || elf_read_firmware(elf, &firmware))
        return NULL;
    firmware.frequency = frequency;
    strncpy(firmware.mmcu, mcu, sizeof firmware.mmcu - 1);
    avr_load_firmware(avr, &firmware);
    avr->frequency = frequency;
    avr->log = 1; /* errors: overruns are among them */
    avr->sleep = never_sleep;
    avr->vcc = avr->avcc = avr->aref = 5000; /* mV */
    board_t *board = calloc(1, sizeof *board);
    board->avr = avr;
    for (uint8_t p = 0; p < PORTS; p++)
        for (uint8_t bit = 0; bit < 8; bit++)
            board->pins[p][bit] = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('A' + p), bit);
    for (uint8_t i = 0; i < 2; i++) {
        char name = (char)('0' + i);
        avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ(name), UART_IRQ_INPUT);
        board->lines[i] = (line_t){.board = board, .input = input};
        if (bauds[i])
            board->lines[i].cycles = frequency * BITS_PER_BYTE / bauds[i];
    }
    avr_irq_t *output = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT);
    avr_irq_register_notify(output, said, board);
    /* An INT pin that lies low in its default level mode would make an event every cycle. */
    for (uint8_t i = 0; i < 8; i++)
        avr_extint_set_strict_lvl_trig(avr, i, 0);
    board->adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    wire_bus(board);
    after_reset(board);
    board->resets = 0;
    return board;
}

EXPORT void board_free(board_t *board)
{
    avr_terminate(board->avr);
    free(board->lines[0].queue.bytes);
    free(board->lines[1].queue.bytes);
    free(board->out.bytes);
    free(board->edges);
    free(board);
}

static avr_cycle_count_t arrive(avr_t *avr, avr_cycle_count_t when, void *given)
{
    (void)avr, (void)when, (void)given;
    return 0;
}

/* Run to a cycle, at most an instruction beyond. Returns the processor's state. The loop watches
 * the cycle, not a timer: a sleeping processor runs past its timers. */
EXPORT int board_run(board_t *board, uint64_t cycle)
{
    avr_t *avr = board->avr;
    int state = avr->state;
    running = board;
    if (avr->cycle < cycle)
        avr_cycle_timer_register(avr, cycle - avr->cycle, arrive, board);
    while (avr->cycle < cycle && state != cpu_Done && state != cpu_Crashed) {
        state = avr_run(avr);
        if (avr->run_cycle_limit != avr->frequency) {
            after_reset(board);
            if (avr->cycle < cycle)
                avr_cycle_timer_register(avr, cycle - avr->cycle, arrive, board);
        }
    }
    avr_cycle_timer_cancel(avr, arrive, board);
    running = NULL;
    return state;
}

EXPORT uint64_t board_cycle(const board_t *board) { return board->avr->cycle; }
EXPORT uint32_t board_resets(const board_t *board) { return board->resets; }
EXPORT uint32_t board_overruns(const board_t *board) { return board->overruns; }
EXPORT void board_reset(board_t *board)
{
    avr_reset(board->avr);
    after_reset(board);
}

/* Put an endless loop where the program stands, until the next reset. */
EXPORT void board_hang(board_t *board)
{
    board->hung_at = board->avr->pc;
    board->hanging = true;
    memcpy(board->hung, board->avr->flash + board->hung_at, 2);
    memcpy(board->avr->flash + board->hung_at, "\xFF\xCF", 2); /* rjmp to itself */
}

EXPORT void board_write(board_t *board, uint8_t which, const uint8_t *bytes, uint32_t count)
{
    line_t *line = &board->lines[which];
    while (count--)
        push(&line->queue, *bytes++);
    if (!line->going && line->queue.count) {
        line->going = true;
        avr_cycle_timer_register(board->avr, line->cycles, deliver, line);
    }
}

EXPORT uint32_t board_read(board_t *board, uint8_t *bytes, uint32_t room)
{
    uint32_t count = 0;
    while (count < room && board->out.count)
        bytes[count++] = pull(&board->out);
    return count;
}

EXPORT void board_voltage(board_t *board, uint8_t channel, uint32_t millivolts)
{
    avr_raise_irq(board->adc + channel, millivolts);
}

EXPORT uint8_t board_peek(const board_t *board, uint16_t address)
{
    return board->avr->data[address];
}

EXPORT void board_eeprom(board_t *board, uint16_t offset, uint8_t *bytes, uint16_t size,
                         uint8_t write)
{
    avr_eeprom_desc_t store = {.ee = bytes, .offset = offset, .size = size};
    if (write) {
        avr_ioctl(board->avr, AVR_IOCTL_EEPROM_SET, &store);
        return;
    }
    store.ee = NULL;
    avr_ioctl(board->avr, AVR_IOCTL_EEPROM_GET, &store);
    memcpy(bytes, store.ee, size);
}
