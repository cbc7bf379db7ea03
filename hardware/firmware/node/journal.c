#include "journal.h"

#include <string.h>

#include "bytes.h"
#include "crc32.h"

enum { CRC_AT = RECORD_BYTES - 4, WRITE_UNIT_MAX = 32, SLOT_MAX = 64, SECTORS_MIN = 2, ERASED = 0xFF };

/* Bytes of a slot: a record in whole write units. */
static uint32_t slot_bytes(const Hal *hal) {
    const uint32_t unit = hal->write_unit > 1 ? hal->write_unit : 1;
    return (RECORD_BYTES + unit - 1) / unit * unit;
}

static uint32_t in_sector(const Journal *journal) {
    return journal->hal->sector_bytes / slot_bytes(journal->hal);
}

static uint32_t slots_of(const Journal *journal) {
    return journal->hal->sectors * in_sector(journal);
}

static uint32_t offset_of(const Journal *journal, uint32_t slot) {
    const uint32_t each = in_sector(journal);
    return slot / each * journal->hal->sector_bytes + slot % each * slot_bytes(journal->hal);
}

/* With one sector, a power failure after its erasure would leave no record at all. */
static bool is_usable(const Hal *hal) {
    const uint32_t unit = hal->write_unit;
    return hal->sectors >= SECTORS_MIN && unit <= WRITE_UNIT_MAX && (unit & (unit - 1)) == 0 &&
           (unit == 0 || hal->sector_bytes % unit == 0) && hal->sector_bytes >= slot_bytes(hal);
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

static bool load(const Journal *journal, uint32_t slot, uint8_t bytes[SLOT_MAX]) {
    return journal->hal->storage_read(journal->hal->context, offset_of(journal, slot), bytes, slot_bytes(journal->hal));
}

/* Whether a record newer than the newest one may stand where storage cannot be read: behind it in its sector, or in the
 * next sector, unless a record there shows that it was not erased since. */
static bool may_hide_newer(const Journal *journal) {
    const uint32_t each = in_sector(journal), behind = (each - journal->next % each) % each;
    bool unread = false;
    for (uint32_t k = 0; k < behind + each && !(unread && k == behind); k++) {
        uint8_t bytes[SLOT_MAX];
        Record record;
        if (!load(journal, (journal->next + k) % slots_of(journal), bytes))
            unread = true;
        else if (read_bytes(bytes, &record) && (record.number > journal->newest.number || k >= behind))
            return record.number > journal->newest.number; /* newer: it could be read only now */
    }
    return unread;
}

void journal_open(Journal *journal, const Hal *hal) {
    *journal = (Journal){.hal = hal, .damaged = !is_usable(hal)};
    bool unread = false;
    for (uint32_t slot = 0; !journal->damaged && slot < slots_of(journal); slot++) {
        uint8_t bytes[SLOT_MAX];
        Record record;
        if (!load(journal, slot, bytes)) {
            unread = true;
        } else if (read_bytes(bytes, &record) && record.number > journal->newest.number) {
            journal->newest = record;
            journal->next = (slot + 1) % slots_of(journal);
        }
    }
    journal->unread = unread && (journal->newest.number == 0 || may_hide_newer(journal));
}

void journal_give_up(Journal *journal) {
    journal->newest.number += slots_of(journal);
    journal->unread = false;
}

static bool is_erased(const Journal *journal, uint32_t slot) {
    uint8_t bytes[SLOT_MAX];
    if (!load(journal, slot, bytes))
        return false;
    for (uint32_t k = 0; k < slot_bytes(journal->hal); k++)
        if (bytes[k] != ERASED)
            return false;
    return true;
}

static bool is_sector_erased(const Journal *journal, uint32_t first) {
    for (uint32_t slot = first; slot < first + in_sector(journal); slot++)
        if (!is_erased(journal, slot))
            return false;
    return true;
}

/* Erases the sector that begins at the next slot, if one does. The whole sector is erased: an erasure interrupted by a
 * power failure may have left old records behind the first slot. */
static bool open_sector(const Journal *journal) {
    const uint32_t each = in_sector(journal);
    return journal->next % each != 0 || is_sector_erased(journal, journal->next) ||
           journal->hal->storage_erase(journal->hal->context, journal->next / each);
}

static bool write_next(const Journal *journal, const Record *record) {
    uint8_t bytes[SLOT_MAX], found[SLOT_MAX];
    const uint32_t length = slot_bytes(journal->hal);
    memset(bytes, ERASED, sizeof bytes);
    write_bytes(record, bytes);
    return journal->hal->storage_write(journal->hal->context, offset_of(journal, journal->next), bytes, length) &&
           load(journal, journal->next, found) && memcmp(bytes, found, length) == 0;
}

/* A slot that is torn, or that refuses the record, is skipped; with as many tries as a sector has slots, the sector of
 * the newest record is never erased. */
bool journal_append(Journal *journal, Record record) {
    if (journal->damaged || journal->unread)
        return false;
    record.number = journal->newest.number;
    for (uint32_t tried = 0; tried < in_sector(journal) && open_sector(journal); tried++) {
        const bool erased = is_erased(journal, journal->next);
        record.number += erased ? 1 : 0;
        const bool written = erased && write_next(journal, &record);
        journal->next = (journal->next + 1) % slots_of(journal);
        if (written) {
            journal->newest = record;
            return true;
        }
    }
    journal->damaged = true;
    return false;
}

uint32_t journal_read(const Journal *journal, uint8_t *to, uint32_t most) {
    uint32_t found = 0, above = UINT32_MAX;
    const uint32_t slots = is_usable(journal->hal) ? slots_of(journal) : 0;
    for (uint32_t back = 1; back <= slots && found < most; back++) {
        uint8_t bytes[SLOT_MAX];
        Record record;
        if (!load(journal, (journal->next + slots - back) % slots, bytes) || !read_bytes(bytes, &record) ||
            record.number >= above)
            continue;
        memcpy(to + RECORD_BYTES * found++, bytes, RECORD_BYTES);
        above = record.number;
    }
    return found;
}
