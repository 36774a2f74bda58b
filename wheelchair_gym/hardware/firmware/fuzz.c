/* Fuzzing of all that the boards read: frames, messages, the joystick, EEPROM.
 *
 * With clang: libFuzzer. Else a main of its own, that mutates good frames: `fuzz COUNT [SEED]`.
 * Either way the laws are checked: motors never get more than full voltage, never anything without
 * a person's re-arm, the set point never leaves its limits, and with a person at the joystick it only
 * falls while the interlock is shut: its dead-man switch is let go, or neutral was not seen since then.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drive.h"
#include "frame.h"
#include "ranging.h"

#define MUST(law)                                                      \
    do {                                                               \
        if (!(law)) {                                                  \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #law);  \
            abort();                                                   \
        }                                                              \
    } while (0)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    drive_t drive;
    ranging_t ranging;
    receiver_t receiver = {0};
    uint8_t image[STORE_MAX] = {0}, answer[PAYLOAD_MAX];
    outputs_t outputs;
    drive_begin(&drive);
    ranging_begin(&ranging);
    memcpy(image, data, size < sizeof image ? size : sizeof image);
    restore_parameters(&drive.parameters, image);
    drive_restored(&drive);
    restore_parameters(&ranging.parameters, image);
    for (size_t i = 0; i < size; i++) {
        uint32_t now = (uint32_t)i;
        bool save = false;
        joystick_byte(&drive.joystick, data[i], now);
        uint8_t got = receive(&receiver, data[i]);
        if (got) {
            uint16_t before = drive.faults;
            answered_t told = drive_heed(&drive, receiver.body, got, now, answer, &save);
            MUST(told.size <= PAYLOAD_MAX);
            MUST(drive.faults == before || receiver.body[1] == REARM);
            MUST(drive.faults & STORE || !(before & STORE) || drive.parameters.stored);
            drive.parameters.stored |= save;
            told = ranging_heed(&ranging, receiver.body, got, answer, &save);
            MUST(told.size <= PAYLOAD_MAX);
        }
        if (i % 5 == 0) {
            uint16_t passed = data[i] & 1 ? 5000 : (uint16_t)(data[i] * data[0]);
            inputs_t inputs = {now, passed, {data[i], -data[i]}, data[i], (uint8_t)(data[i] & data[0]),
                               36.0F};
            uint16_t latched = drive.faults;
            float before = fabsf(drive.v.speed);
            drive_step(&drive, &inputs, &outputs);
            drive_look(&drive);
            MUST(!outputs.release || outputs.enable);
            MUST(!(outputs.enable && latched & (EMERGENCY_STOP | RUNAWAY | IMPLAUSIBLE | STALL)) ||
                 !drive.faults);
            MUST(fabsf(outputs.duty[0]) <= 1.0F && fabsf(outputs.duty[1]) <= 1.0F);
            MUST(drive.v.speed <= drive.p.forward * 1.1F + 0.1F);
            MUST(drive.v.speed >= -drive.p.backward * 1.1F - 0.1F);
            bool braking = inputs.switches & FREEWHEEL && !outputs.release;
            braking = braking && outputs.duty[0] == 0.0F && outputs.duty[1] == 0.0F;
            MUST(!outputs.enable || drive.armed || drive.mode == STOPPING || braking);
            MUST(drive.armed || !(drive.mode == HOST || drive.mode == MANUAL));
            if (drive.mode == MANUAL || (drive.mode == HOST && drive.command.flags & ASSISTED))
                MUST(drive.joystick.free || fabsf(drive.v.speed) <= before);
            MUST(drive.joystick.held || !drive.joystick.free);
            odometry_t told = drive_tell(&drive, now, receiver.bad, 0);
            MUST(told.mode <= READY && (told.mode != READY || drive.armed));
        }
    }
    return 0;
}

#ifndef LIBFUZZER
static uint64_t state;
static uint32_t draw(uint32_t below)
{
    state ^= state << 13; /* xorshift64 */
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)(state >> 33) % below;
}

int main(int argc, char **argv)
{
    unsigned long count = argc > 1 ? strtoul(argv[1], NULL, 10) : 1000000UL;
    state = argc > 2 ? strtoul(argv[2], NULL, 10) : 1;
    static const uint8_t kinds[] = {COMMAND, REARM, GET, SET, SAVE, IDENTIFY, ODOMETRY, 0x55};
    static const uint8_t sizes[] = {sizeof(command_t), sizeof(rearm_t), 1, sizeof(set_t), 0, 0, 34, 7};
    for (unsigned long n = 0; n < count; n++) {
        uint8_t data[256];
        size_t size = 0;
        while (size < 128) {
            uint8_t payload[PAYLOAD_MAX], which = (uint8_t)draw(8);
            for (uint8_t i = 0; i < sizeof payload; i++)
                payload[i] = draw(3) ? 0 : (uint8_t)draw(256);
            uint8_t length = draw(8) ? sizes[which] : (uint8_t)draw(PAYLOAD_MAX + 1);
            size += frame(kinds[which], (uint8_t)n, payload, length, data + size);
        }
        for (uint32_t harm = draw(4); harm > 0; harm--)
            data[draw((uint32_t)size)] = (uint8_t)draw(256);
        LLVMFuzzerTestOneInput(data, size);
    }
    printf("%lu inputs, no law broken\n", count);
    return 0;
}
#endif
