#include "frame.h"

#include <string.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#define READ_ENTRY(entry) pgm_read_dword(&(entry))
#else
#define PROGMEM
#define READ_ENTRY(entry) (entry)
#endif

/* CRC-32 of four bits (reflected polynomial 0xEDB88320): a nibble at a time, 64 bytes of flash. */
static const uint32_t nibbles[16] PROGMEM = {
    0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
    0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C, 0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
};

uint32_t crc32(const uint8_t *bytes, uint8_t length)
{
    uint32_t crc = 0xFFFFFFFFUL;
    while (length--) {
        crc ^= *bytes++;
        crc = (crc >> 4) ^ READ_ENTRY(nibbles[crc & 0x0F]);
        crc = (crc >> 4) ^ READ_ENTRY(nibbles[crc & 0x0F]);
    }
    return ~crc;
}

uint8_t cobs_encode(const uint8_t *body, uint8_t length, uint8_t *out)
{
    uint8_t code = 0, next = 1; /* where the block's length goes, and the next byte */
    for (uint8_t i = 0; i < length; i++) {
        if (body[i]) {
            out[next++] = body[i];
        } else {
            out[code] = (uint8_t)(next - code);
            code = next++;
        }
    }
    out[code] = (uint8_t)(next - code);
    out[next++] = 0;
    return next;
}

uint8_t cobs_decode(uint8_t *bytes, uint8_t length)
{
    uint8_t from = 0, to = 0;
    while (from < length) {
        uint8_t block = bytes[from++];
        if (block == 0 || block - 1 > length - from)
            return 0;
        while (--block)
            bytes[to++] = bytes[from++];
        if (from < length)
            bytes[to++] = 0;
    }
    return to;
}

uint8_t frame(uint8_t kind, uint8_t sequence, const void *payload, uint8_t length, uint8_t *out)
{
    uint8_t body[BODY_MAX]; /* not cleared: that time would add to the odometry's age */
    body[0] = PROTOCOL_VERSION;
    body[1] = kind;
    body[2] = sequence;
    uint8_t size = (uint8_t)(HEAD_SIZE + length);
    memcpy(body + HEAD_SIZE, payload, length);
    uint32_t crc = crc32(body, size);
    memcpy(body + size, &crc, CRC_SIZE);
    return cobs_encode(body, (uint8_t)(size + CRC_SIZE), out);
}

static uint8_t check(receiver_t *receiver)
{
    if (receiver->overflow)
        return 0;
    uint8_t size = cobs_decode(receiver->body, receiver->length);
    if (size < HEAD_SIZE + CRC_SIZE || receiver->body[0] != PROTOCOL_VERSION)
        return 0;
    uint32_t crc;
    size = (uint8_t)(size - CRC_SIZE);
    memcpy(&crc, receiver->body + size, CRC_SIZE);
    return crc == crc32(receiver->body, size) ? size : 0;
}

uint8_t receive(receiver_t *receiver, uint8_t byte)
{
    if (byte) {
        if (receiver->length < ENCODED_MAX)
            receiver->body[receiver->length++] = byte;
        else
            receiver->overflow = true;
        return 0;
    }
    if (receiver->length == 0)
        return 0; /* zeros between frames */
    uint8_t size = check(receiver);
    if (size == 0 && receiver->bad < UINT16_MAX)
        receiver->bad++;
    receiver->length = 0;
    receiver->overflow = false;
    return size;
}
