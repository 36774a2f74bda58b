/* Two models of sonar at a board's pins and on its I2C bus. */
#include <simavr/avr_twi.h>
#include <simavr/sim_cycle_timers.h>

#include "emulator.h"

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

void wire_bus(board_t *board)
{
    board->twi = avr_io_getirq(board->avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    if (board->twi)
        avr_irq_register_notify(board->twi + TWI_IRQ_OUTPUT, bus, board);
}

void hush_sonars(board_t *board)
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
