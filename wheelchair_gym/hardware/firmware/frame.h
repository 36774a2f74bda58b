/* Frames: COBS and CRC-32, and a receiver that takes one byte at a time. */
#ifndef FRAME_H
#define FRAME_H

#include "protocol.h"

typedef struct {
    uint8_t body[ENCODED_MAX]; /* of the frame that is coming in; decoded in place */
    uint8_t length;
    bool overflow;
    uint16_t bad; /* frames refused; stays at its largest value */
} receiver_t;

uint32_t crc32(const uint8_t *bytes, uint8_t length);

/* Encode a body of at most BODY_MAX bytes; `out` holds length + 2. Returns its length, the final
 * zero included. */
uint8_t cobs_encode(const uint8_t *body, uint8_t length, uint8_t *out);

/* Decode in place, without the final zero. Returns the length, 0 if it is not COBS. */
uint8_t cobs_decode(uint8_t *bytes, uint8_t length);

/* A whole frame of a payload of at most PAYLOAD_MAX bytes; `out` holds ENCODED_MAX + 1. */
uint8_t frame(uint8_t kind, uint8_t sequence, const void *payload, uint8_t length, uint8_t *out);

/* Take one byte. Returns the length of head and payload in `body` when a good frame ends, else 0. */
uint8_t receive(receiver_t *receiver, uint8_t byte);

#endif
