/* Download of a pattern and upload of a height map (0x34, 0x35, 0x36, 0x37).
 *
 *     34 00 44 layer (4) size (4)   pattern as pattern.h has it; 10 instead of 00: run-length coded. The job is that
 *                                   of MasterAlive
 *     35 00 44 layer (4) size (4)   the last scan as height_map.h has it
 *     36 counter bytes...           counter from 1, after 255 comes 0; the newest block may be repeated
 *     36 counter [most (2)]         of an upload: no more than `most` bytes, else as many as fit; a repeat with a lower
 *                                   `most` gives the front of that block, and the next block begins after it
 *     37 crc (4)                    CRC-32 of all bytes as transferred; of an upload: 37 alone, the answer carries it
 */
#ifndef INKLOOP_TRANSFER_H
#define INKLOOP_TRANSFER_H

#include "uds.h"

enum { BLOCK_MAX = 4095 }; /* largest block with the two first bytes of 0x36: the limit of ISO-TP */

size_t transfer_download(Node *node, const uint8_t *request, size_t length, uint8_t *answer);
size_t transfer_upload(Node *node, const uint8_t *request, size_t length, uint8_t *answer);
size_t transfer_block(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room);

/* `cause` is set if the node has to switch off: the journal is damaged. */
size_t transfer_exit(Node *node, const uint8_t *request, size_t length, uint8_t *answer, Cause *cause);

#endif
