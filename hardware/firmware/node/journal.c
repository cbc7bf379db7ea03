#include "journal.h"

#include <string.h>

#include "bytes.h"
#include "crc32.h"

enum { CRC_AT = RECORD_BYTES - 4 };

static uint32_t slots_of(const Journal *journal) {
    return journal->hal->sectors * (journal->hal->sector_bytes / RECORD_BYTES);
}

static uint32_t offset_of(const Journal *journal, uint32_t slot) {
    const uint32_t in_sector = journal->hal->sector_bytes / RECORD_BYTES;
    return slot / in_sector * journal->hal->sector_bytes + slot % in_sector * RECORD_BYTES;
}

static void write_bytes(const Record *record, uint8_t bytes[RECORD_BYTES]) {
    const LayerProgress *progress = &record->progress;
    put_u32(bytes, record->number);
    bytes[4] = (uint8_t)record->kind;
    bytes[5] = (uint8_t)record->step;
    bytes[6] = record->pass;
    bytes[7] = record->attempt;
    put_u32(bytes + 8, progress->job);
    put_u16(bytes + 12, progress->layer);
    put_u16(bytes + 14, progress->boots);
    put_u32(bytes + 16, progress->pattern_crc);
    bytes[20] = progress->passes;
    bytes[21] = progress->done;
    bytes[22] = progress->unknown;
    bytes[23] = progress->cured;
    put_u32(bytes + 24, progress->flags);
    put_u32(bytes + 28, record->time_ms);
    put_u32(bytes + 32, 0);
    put_u32(bytes + CRC_AT, crc32_after(0, bytes, CRC_AT));
}

/* Whether the numbers of a record are possible: another firmware may have written records with a right checksum. */
static bool is_possible(const uint8_t bytes[RECORD_BYTES]) {
    const uint8_t passes = bytes[20], masks = bytes[21] | bytes[22] | bytes[23];
    return get_u32(bytes) > 0 && bytes[4] >= RECORD_BOOT && bytes[4] <= RECORD_WATCHDOG && bytes[5] <= STEP_SCAN &&
           bytes[6] < PASSES_MAX && (passes == 0 || passes == 1 || passes == PASSES_MAX) && masks < 1u << PASSES_MAX;
}

/* False: erased, torn, or never a record. */
static bool read_bytes(const uint8_t bytes[RECORD_BYTES], Record *record) {
    if (get_u32(bytes + CRC_AT) != crc32_after(0, bytes, CRC_AT) || !is_possible(bytes))
        return false;
    record->number = get_u32(bytes);
    record->kind = (RecordKind)bytes[4];
    record->step = (StepKind)bytes[5];
    record->pass = bytes[6];
    record->attempt = bytes[7];
    record->progress = (LayerProgress){.job = get_u32(bytes + 8),
                                       .layer = get_u16(bytes + 12),
                                       .boots = get_u16(bytes + 14),
                                       .pattern_crc = get_u32(bytes + 16),
                                       .passes = bytes[20],
                                       .done = bytes[21],
                                       .unknown = bytes[22],
                                       .cured = bytes[23],
                                       .flags = bytes[27]};
    record->time_ms = get_u32(bytes + 28);
    return true;
}

static bool load(const Journal *journal, uint32_t slot, uint8_t bytes[RECORD_BYTES]) {
    return journal->hal->storage_read(journal->hal->context, offset_of(journal, slot), bytes, RECORD_BYTES);
}

void journal_open(Journal *journal, const Hal *hal) {
    *journal = (Journal){.hal = hal};
    for (uint32_t slot = 0; slot < slots_of(journal); slot++) {
        uint8_t bytes[RECORD_BYTES];
        Record record;
        if (!load(journal, slot, bytes) || !read_bytes(bytes, &record) || record.number <= journal->newest.number)
            continue;
        journal->newest = record;
        journal->next = (slot + 1) % slots_of(journal);
    }
}

static bool is_erased(const Journal *journal, uint32_t slot) {
    uint8_t bytes[RECORD_BYTES];
    if (!load(journal, slot, bytes))
        return false;
    for (uint32_t k = 0; k < RECORD_BYTES; k++)
        if (bytes[k] != 0xFF)
            return false;
    return true;
}

static bool is_sector_erased(const Journal *journal, uint32_t first, uint32_t slots) {
    for (uint32_t slot = first; slot < first + slots; slot++)
        if (!is_erased(journal, slot))
            return false;
    return true;
}

/* Moves `next` to a slot that can be written: past torn ones, and into a sector that is erased first. The whole sector
 * is erased: an erasure interrupted by a power failure may have left old records behind the first slot. */
static bool find_room(Journal *journal) {
    const uint32_t in_sector = journal->hal->sector_bytes / RECORD_BYTES;
    for (uint32_t tried = 0; tried <= in_sector; tried++) {
        if (journal->next % in_sector == 0 && !is_sector_erased(journal, journal->next, in_sector) &&
            !journal->hal->storage_erase(journal->hal->context, journal->next / in_sector))
            return false;
        if (is_erased(journal, journal->next))
            return true;
        journal->next = (journal->next + 1) % slots_of(journal);
    }
    return false;
}

bool journal_append(Journal *journal, Record record) {
    uint8_t bytes[RECORD_BYTES], found[RECORD_BYTES];
    record.number = journal->newest.number + 1;
    write_bytes(&record, bytes);
    if (journal->damaged || !find_room(journal) ||
        !journal->hal->storage_write(journal->hal->context, offset_of(journal, journal->next), bytes, RECORD_BYTES) ||
        !load(journal, journal->next, found) || memcmp(bytes, found, RECORD_BYTES) != 0) {
        journal->damaged = true;
        return false;
    }
    journal->newest = record;
    journal->next = (journal->next + 1) % slots_of(journal);
    return true;
}

uint32_t journal_read(const Journal *journal, uint8_t *to, uint32_t most) {
    uint32_t found = 0;
    for (uint32_t back = 1; back <= slots_of(journal) && found < most; back++) {
        Record record;
        const uint32_t slot = (journal->next + slots_of(journal) - back) % slots_of(journal);
        if (load(journal, slot, to + found * RECORD_BYTES) && read_bytes(to + found * RECORD_BYTES, &record))
            found++;
    }
    return found;
}
