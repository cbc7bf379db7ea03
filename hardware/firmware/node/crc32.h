/* CRC-32 of zlib, PNG and Ethernet (reflected polynomial 0xEDB88320): the last field of every transfer and every
 * journal record. */
#ifndef INKLOOP_CRC32_H
#define INKLOOP_CRC32_H

#include <stddef.h>
#include <stdint.h>

/* CRC of `bytes` after data of CRC `before`; 0 to begin. */
uint32_t crc32_after(uint32_t before, const uint8_t *bytes, size_t length);

#endif
