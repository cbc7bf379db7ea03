/* The wire library behind plain numbers and bytes, for tests that load it with ctypes. */
#include <string.h>

#include "e2e.h"
#include "e2e_monitor.h"
#include "isotp.h"
#include "slcan.h"

size_t probe_sizes(int which);
void probe_isotp_init(Isotp *end, uint32_t receive_id, uint32_t send_id, uint8_t block_size, uint8_t separation);
int probe_isotp_take(Isotp *end, uint32_t id, const uint8_t *data, uint8_t length, uint32_t now);
int probe_isotp_next(Isotp *end, uint32_t now, uint32_t *id, uint8_t *data);
size_t probe_isotp_received(Isotp *end, uint8_t *bytes);
void probe_isotp_state(const Isotp *end, uint32_t *numbers);
int probe_slcan_take(Slcan *slcan, uint8_t byte, uint32_t *numbers, uint8_t *data, uint8_t *answer);
void probe_slcan_counts(const Slcan *slcan, uint32_t *numbers);
size_t probe_slcan_write(uint32_t id, int extended, int remote, uint8_t length, const uint8_t *data, char *line);
void probe_monitor_counts(const E2eMonitor *monitor, uint32_t *numbers);

size_t probe_sizes(int which) {
    const size_t sizes[] = {sizeof(Isotp), sizeof(Slcan), sizeof(E2eMonitor)};
    return sizes[which];
}

void probe_isotp_init(Isotp *end, uint32_t receive_id, uint32_t send_id, uint8_t block_size, uint8_t separation) {
    const IsotpOptions options = {.receive_id = receive_id,
                                  .send_id = send_id,
                                  .block_size = block_size,
                                  .separation = separation,
                                  .padding = 0xCC,
                                  .wait_max = 2,
                                  .flow_timeout = 1000,
                                  .frame_timeout = 1000};
    isotp_init(end, &options);
}

int probe_isotp_take(Isotp *end, uint32_t id, const uint8_t *data, uint8_t length, uint32_t now) {
    CanFrame frame = {.id = id, .length = length};
    memcpy(frame.data, data, length);
    return isotp_take(end, &frame, now);
}

int probe_isotp_next(Isotp *end, uint32_t now, uint32_t *id, uint8_t *data) {
    CanFrame frame;
    if (!isotp_next(end, now, &frame))
        return 0;
    *id = frame.id;
    memcpy(data, frame.data, frame.length);
    return frame.length;
}

size_t probe_isotp_received(Isotp *end, uint8_t *bytes) {
    size_t length;
    const uint8_t *message = isotp_received(end, &length);
    if (message)
        memcpy(bytes, message, length);
    isotp_release(end);
    return length;
}

void probe_isotp_state(const Isotp *end, uint32_t *numbers) {
    const uint32_t state[] = {end->sending.end,     end->receiving.end,    end->count.received,
                              end->count.sent,      end->count.dropped,    end->count.replaced,
                              end->count.malformed, end->count.unexpected, isotp_is_sending(end)};
    memcpy(numbers, state, sizeof state);
}

int probe_slcan_take(Slcan *slcan, uint8_t byte, uint32_t *numbers, uint8_t *data, uint8_t *answer) {
    SlcanEvent event;
    if (!slcan_take(slcan, byte, &event))
        return -1;
    numbers[0] = event.has_frame;
    numbers[1] = event.frame.id;
    numbers[2] = event.frame.extended;
    numbers[3] = event.frame.remote;
    numbers[4] = event.frame.length;
    memcpy(data, event.frame.data, CAN_DATA_MAX);
    memcpy(answer, event.answer, event.answer_length);
    return event.answer_length;
}

void probe_slcan_counts(const Slcan *slcan, uint32_t *numbers) {
    numbers[0] = slcan->frames;
    numbers[1] = slcan->malformed;
    numbers[2] = slcan->refused;
}

size_t probe_slcan_write(uint32_t id, int extended, int remote, uint8_t length, const uint8_t *data, char *line) {
    CanFrame frame = {.id = id, .extended = extended, .remote = remote, .length = length};
    memcpy(frame.data, data, CAN_DATA_MAX);
    return slcan_write(&frame, line);
}

void probe_monitor_counts(const E2eMonitor *monitor, uint32_t *numbers) {
    const uint32_t counts[] = {monitor->damaged, monitor->repeated, monitor->jumped, monitor->lost, monitor->stuck};
    memcpy(numbers, counts, sizeof counts);
}
