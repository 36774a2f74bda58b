#include "parameters.h"

#include <string.h>

#include "frame.h"

#ifdef __AVR__
#include <avr/pgmspace.h>
#else
#define memcpy_P memcpy
#endif

bounds_t bounds_of(const parameters_t *parameters, uint8_t index)
{
    bounds_t bounds;
    memcpy_P(&bounds, &parameters->bounds[index], sizeof bounds);
    return bounds;
}

void use_defaults(parameters_t *parameters)
{
    for (uint8_t i = 0; i < parameters->count; i++)
        parameters->values[i] = bounds_of(parameters, i).initial;
    parameters->stored = false;
}

/* NaN lies in no bounds. */
static bool within(bounds_t bounds, float value)
{
    return value >= bounds.low && value <= bounds.high;
}

parameter_t get_parameter(const parameters_t *parameters, uint8_t index)
{
    parameter_t answer = {.number = index, .status = UNKNOWN};
    if (index < parameters->count) {
        bounds_t bounds = bounds_of(parameters, index);
        answer.status = DONE;
        answer.value = parameters->values[index];
        answer.low = bounds.low;
        answer.high = bounds.high;
    }
    return answer;
}

parameter_t set_parameter(parameters_t *parameters, uint8_t index, float value, bool at_rest)
{
    parameter_t answer = get_parameter(parameters, index);
    if (answer.status != DONE)
        return answer;
    if (!within(bounds_of(parameters, index), value))
        answer.status = OUT_OF_RANGE;
    else if (!at_rest)
        answer.status = MOVING;
    else
        answer.value = parameters->values[index] = value;
    return answer;
}

void store_parameters(const parameters_t *parameters, uint8_t *image)
{
    uint8_t size = (uint8_t)(STORE_SIZE(parameters->count) - CRC_SIZE);
    store_head_t head = {PROTOCOL_VERSION, parameters->board, parameters->count};
    memcpy(image, &head, sizeof head);
    memcpy(image + sizeof head, parameters->values, parameters->count * sizeof(float));
    uint32_t crc = crc32(image, size);
    memcpy(image + size, &crc, CRC_SIZE);
}

bool restore_parameters(parameters_t *parameters, const uint8_t *image)
{
    uint8_t size = (uint8_t)(STORE_SIZE(parameters->count) - CRC_SIZE);
    store_head_t head;
    uint32_t crc;
    memcpy(&head, image, sizeof head);
    memcpy(&crc, image + size, CRC_SIZE);
    use_defaults(parameters);
    if (head.version != PROTOCOL_VERSION || head.board != parameters->board ||
        head.count != parameters->count || crc != crc32(image, size))
        return false;
    for (uint8_t i = 0; i < parameters->count; i++) {
        float value;
        memcpy(&value, image + sizeof head + i * sizeof(float), sizeof value);
        if (!within(bounds_of(parameters, i), value)) {
            use_defaults(parameters);
            return false;
        }
        parameters->values[i] = value;
    }
    return parameters->stored = true;
}

static answered_t tell_parameter(parameter_t parameter, uint8_t *answer)
{
    memcpy(answer, &parameter, sizeof parameter);
    return (answered_t){PARAMETER, sizeof parameter};
}

answered_t heed(parameters_t *parameters, const uint8_t *body, uint8_t size, bool at_rest,
                uint8_t status, uint8_t *answer, bool *save)
{
    const uint8_t kind = body[1], *payload = body + HEAD_SIZE;
    size = (uint8_t)(size - HEAD_SIZE);
    if (kind == GET && size == sizeof(get_t))
        return tell_parameter(get_parameter(parameters, payload[0]), answer);
    if (kind == SET && size == sizeof(set_t)) {
        set_t set;
        memcpy(&set, payload, sizeof set);
        return tell_parameter(set_parameter(parameters, set.number, set.value, at_rest), answer);
    }
    if (kind == IDENTIFY && size == 0) {
        /* The cause of the reset is known to the board, which fills it in. */
        identity_t identity = {parameters->board, parameters->count, 0, parameters->stored};
        memcpy(answer, &identity, sizeof identity);
        return (answered_t){IDENTITY, sizeof identity};
    }
    if (kind == SAVE && size == 0) {
        status = at_rest ? DONE : MOVING;
        *save = at_rest;
    }
    answer_t told = {kind, body[2], status};
    memcpy(answer, &told, sizeof told);
    return (answered_t){ANSWER, sizeof told};
}
