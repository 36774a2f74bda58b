/* Parameters of a board: a table of floats with bounds, kept in EEPROM under a checksum. */
#ifndef PARAMETERS_H
#define PARAMETERS_H

#include "protocol.h"

typedef struct {
    float initial, low, high;
} bounds_t;

/* What EEPROM holds: head, values, CRC-32 of both. */
typedef struct PACKED {
    uint8_t version; /* of the protocol: other versions may have other parameters */
    uint8_t board;
    uint8_t count;
} store_head_t;

#define PARAMETERS_MAX 48
#define STORE_MAX (sizeof(store_head_t) + PARAMETERS_MAX * sizeof(float) + CRC_SIZE)
#define STORE_SIZE(count) ((uint8_t)(sizeof(store_head_t) + (count) * sizeof(float) + CRC_SIZE))

typedef struct {
    const bounds_t *bounds; /* in flash, on AVR */
    float *values;
    uint8_t count;
    uint8_t board;
    bool stored; /* EEPROM holds values that a host has stored */
} parameters_t;

bounds_t bounds_of(const parameters_t *parameters, uint8_t index);
void use_defaults(parameters_t *parameters);

/* Answers for GET and SET; SET is refused unless `at_rest`. */
parameter_t get_parameter(const parameters_t *parameters, uint8_t index);
parameter_t set_parameter(parameters_t *parameters, uint8_t index, float value, bool at_rest);

/* The image for EEPROM, STORE_SIZE(count) bytes; and back. Garbage, an image of another board or a
 * value out of bounds leaves the defaults, and is told. */
void store_parameters(const parameters_t *parameters, uint8_t *image);
bool restore_parameters(parameters_t *parameters, const uint8_t *image);

/* Heed what every board heeds: GET, SET, SAVE, IDENTIFY, with the answer's payload in `answer`
 * (PAYLOAD_MAX). Anything else gets an ANSWER of `status`. `save` is set when EEPROM is to be
 * written. */
typedef struct {
    uint8_t kind, size; /* of the answer; kind 0: none */
} answered_t;
answered_t heed(parameters_t *parameters, const uint8_t *body, uint8_t size, bool at_rest,
                uint8_t status, uint8_t *answer, bool *save);

#endif
