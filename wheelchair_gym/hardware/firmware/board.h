/* What both boards have: a tick, a serial line to the host, a watchdog timer, EEPROM. */
#ifndef BOARD_H
#define BOARD_H

#include "parameters.h"

void board_begin(parameters_t *parameters);

uint32_t board_now(void);       /* ms since reset */
uint16_t board_micros(void);    /* us since reset, in steps of 8 */
uint8_t board_lost(void);       /* bytes and frames dropped for want of room */
uint16_t board_bad(void);       /* frames refused */

/* The next good frame from the host; its size, head included. 0: not before a later call, for each
 * takes RECEIVE_MAX bytes at most, so that a host can keep nobody from the rest of the work. */
uint8_t board_receive(const uint8_t **body);
void board_send(uint8_t kind, const void *payload, uint8_t length);
void board_answer(answered_t answered, uint8_t *answer);
void board_identify(const parameters_t *parameters);

/* Write the parameters to EEPROM, a byte whenever it is ready, and read them back: never waits.
 * They are `stored` when what was read is what was written. */
bool board_save(parameters_t *parameters);
void board_save_on(parameters_t *parameters);

/* Sleep until a byte waits or the tick has moved on from `seen`. */
void board_sleep(uint32_t seen);

#endif
