/* A board on simavr, run to an exact cycle: pins, serial lines, ADC, EEPROM, two models of sonar.
 *
 * Links simavr, which is GPL-3: a tool built by its user, no part of the program that drives.
 * Peculiarities of simavr 1.6 are explained where they are handled.
 */
#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>
#include <simavr/sim_irq.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))
#define PORTS 12 /* A to L */
#define SONARS 10
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
    uint8_t clocks_due; /* of SCL, until a slave lets SDA go */
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

/* Pins driven from outside: at once, or at exact cycles as an encoder's. */

/* A driven pin is declared to its port, or the next write of PORT or DDR would raise it to
 * its pull-up's level. */

static void declare(board_t *board, uint8_t p)
{
    avr_ioport_external_t external = {
        .name = 'A' + p, .mask = board->driven[p], .value = board->levels[p]};
    avr_ioctl(board->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('A' + p), &external);
}

static void set_pin(board_t *board, char port, uint8_t bit, uint8_t level)
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

static void restore_pins(board_t *board)
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

/* Ultrasonic sensors at the board's pins and on its I2C bus. */

#define SILENT (-1) /* flights [us] that are none; 0 is no echo */

/* Sonar by pulse (HC-SR04): a trigger of 10 us or more, an echo as long as the flight; 38 ms where
 * nothing answers. */

static avr_cycle_count_t sound(avr_t *avr, avr_cycle_count_t when, void *given)
{
    (void)avr;
    sonar_t *sonar = given;
    sonar->high = !sonar->high;
    set_pin(sonar->board, sonar->echo_port, sonar->echo_bit, sonar->high);
    if (sonar->high)
        return when + cycles_of(sonar->board, sonar->length);
    sonar->sounding = false;
    return 0;
}

static void triggered(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq;
    sonar_t *sonar = given;
    board_t *board = sonar->board;
    uint64_t now = board->avr->cycle;
    if (value & 1) {
        sonar->rose = now;
        return;
    }
    if (sonar->rose == 0 || sonar->sounding || now - sonar->rose < cycles_of(board, 10))
        return;
    sonar->rose = 0;
    int32_t flight = board->ping ? board->ping(sonar->which, now) : 0;
    if (flight == SILENT)
        return;
    sonar->sounding = true;
    sonar->length = flight ? (uint32_t)flight : 38000;
    avr_cycle_timer_register(board->avr, cycles_of(board, 450), sound, sonar);
}

/* Sonar by I2C (SRF08): registers 0 command, 1 gain, 2 range; 2 and 3 read the first echo [us].
 * While it listens it does not answer. */

static uint8_t read_sonar(sonar_t *sonar)
{
    uint8_t byte = sonar->at_register == 2   ? (uint8_t)(sonar->result >> 8)
                   : sonar->at_register == 3 ? (uint8_t)sonar->result
                                             : 0;
    sonar->at_register++;
    return byte;
}

static void write_sonar(sonar_t *sonar, uint8_t byte)
{
    board_t *board = sonar->board;
    if (sonar->bytes++ == 0) {
        sonar->at_register = byte;
        return;
    }
    if (sonar->at_register == 0 && byte == 0x52) {
        int32_t flight = board->ping ? board->ping(sonar->which, board->avr->cycle) : 0;
        sonar->result = flight > 0 ? (uint16_t)flight : 0;
        sonar->ready = board->avr->cycle + cycles_of(board, 40000);
    }
    sonar->at_register++;
}

static void bus(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq;
    board_t *board = given;
    avr_twi_msg_irq_t message = {.u.v = value};
    uint8_t what = message.u.twi.msg, address = message.u.twi.addr;
    if (board->clocks_due)
        return;
    if (what & TWI_COND_STOP)
        board->addressed = NULL;
    if (what & TWI_COND_START) {
        board->addressed = NULL;
        for (uint8_t i = 0; i < board->sonar_count; i++) {
            sonar_t *sonar = &board->sonars[i];
            if (!sonar->address || sonar->address != (address & 0xFE))
                continue;
            if (board->avr->cycle < sonar->ready ||
                (board->ping && board->ping(sonar->which | 0x80, board->avr->cycle) == SILENT))
                continue; /* bit 7 asks whether it is there at all */
            sonar->bytes = 0;
            board->addressed = sonar;
            avr_raise_irq(board->twi + TWI_IRQ_INPUT,
                          avr_twi_irq_msg(TWI_COND_ACK, address, 1));
        }
        return;
    }
    sonar_t *sonar = board->addressed;
    if (!sonar)
        return;
    if (what & TWI_COND_WRITE) {
        avr_raise_irq(board->twi + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, address, 1));
        write_sonar(sonar, message.u.twi.data);
    }
    if (what & TWI_COND_READ)
        avr_raise_irq(board->twi + TWI_IRQ_INPUT,
                      avr_twi_irq_msg(TWI_COND_READ, address, read_sonar(sonar)));
}

/* A slave that was interrupted amid a byte holds SDA low until it has had its clocks. simavr starts a
 * transaction all the same: it looks at no pin. */

static const char BUS_PORT = 'C';
enum { BUS_SDA = 4, BUS_SCL = 5 };

static void clocked(avr_irq_t *irq, uint32_t value, void *given)
{
    (void)irq;
    board_t *board = given;
    if (value & 1 && board->clocks_due && --board->clocks_due == 0)
        set_pin(board, BUS_PORT, BUS_SDA, 1);
}

EXPORT void board_hold_bus(board_t *board, uint8_t clocks)
{
    board->clocks_due = clocks;
    set_pin(board, BUS_PORT, BUS_SDA, 0);
    avr_irq_register_notify(board->pins[BUS_PORT - 'A'][BUS_SCL], clocked, board);
}

static void wire_bus(board_t *board)
{
    board->twi = avr_io_getirq(board->avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    if (board->twi)
        avr_irq_register_notify(board->twi + TWI_IRQ_OUTPUT, bus, board);
}

static void hush_sonars(board_t *board)
{
    board->addressed = NULL;
    for (uint8_t i = 0; i < board->sonar_count; i++) {
        sonar_t *sonar = &board->sonars[i];
        sonar->rose = sonar->ready = 0;
        if (sonar->high)
            set_pin(board, sonar->echo_port, sonar->echo_bit, 0);
        sonar->high = sonar->sounding = false;
    }
}

EXPORT void board_on_ping(board_t *board, int32_t (*ping)(uint8_t, uint64_t)) { board->ping = ping; }

static sonar_t *add_sonar(board_t *board)
{
    sonar_t *sonar = &board->sonars[board->sonar_count];
    *sonar = (sonar_t){.board = board, .which = board->sonar_count++};
    return sonar;
}

EXPORT void board_pulse_sonar(board_t *board, char trigger_port, uint8_t trigger_bit,
                              char echo_port, uint8_t echo_bit)
{
    sonar_t *sonar = add_sonar(board);
    sonar->trigger_port = trigger_port;
    sonar->trigger_bit = trigger_bit;
    sonar->echo_port = echo_port;
    sonar->echo_bit = echo_bit;
    set_pin(board, echo_port, echo_bit, 0);
    avr_irq_register_notify(board->pins[trigger_port - 'A'][trigger_bit], triggered, sonar);
}

EXPORT void board_bus_sonar(board_t *board, uint8_t address) { add_sonar(board)->address = address; }

/* Measurements: how long interrupts wait, and when a pin changes. */

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

/* The board itself. */

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
