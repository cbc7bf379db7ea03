#include "height_map.h"

#include "bytes.h"

static uint32_t cells_of(const MapShape *shape) {
    return (uint32_t)shape->nx * shape->ny;
}

uint32_t height_map_bytes(const Hal *hal) {
    const MapShape shape = hal->map_shape(hal->context);
    const uint32_t cells = cells_of(&shape);
    return MAP_HEAD_BYTES + 2 * cells + (cells + 7) / 8;
}

static void write_head(const MapShape *shape, uint8_t head[MAP_HEAD_BYTES]) {
    head[0] = MAP_VERSION;
    head[1] = 0;
    put_u16(head + 2, shape->nx);
    put_u16(head + 4, shape->ny);
    put_u16(head + 6, shape->lsb_nm);
    put_u32(head + 8, (uint32_t)shape->datum);
}

static uint8_t valid_bits(const Hal *hal, uint32_t first, uint32_t cells) {
    uint8_t bits = 0;
    for (uint32_t k = 0; k < 8 && first + k < cells; k++) {
        int16_t reading;
        if (hal->map_reading(hal->context, first + k, &reading))
            bits |= (uint8_t)(0x80u >> k);
    }
    return bits;
}

static uint8_t byte_at(const Hal *hal, const uint8_t head[MAP_HEAD_BYTES], uint32_t cells, uint32_t at) {
    if (at < MAP_HEAD_BYTES)
        return head[at];
    at -= MAP_HEAD_BYTES;
    if (at >= 2 * cells)
        return valid_bits(hal, 8 * (at - 2 * cells), cells);
    int16_t reading = 0;
    if (!hal->map_reading(hal->context, at / 2, &reading))
        reading = 0;
    const uint16_t word = (uint16_t)reading;
    return (uint8_t)(at % 2 == 0 ? word >> 8 : word & 0xFFu);
}

void height_map_read(const Hal *hal, uint32_t from, uint8_t *to, uint32_t length) {
    const MapShape shape = hal->map_shape(hal->context);
    uint8_t head[MAP_HEAD_BYTES];
    write_head(&shape, head);
    for (uint32_t k = 0; k < length; k++)
        to[k] = byte_at(hal, head, cells_of(&shape), from + k);
}
