#include <string.h>

#include "e2e.h"
#include "e2e_monitor.h"

enum { COUNTERS = E2E_COUNTER_MAX + 1, WINDOW_MASK = (1 << E2E_WINDOW) - 1 };

void e2e_monitor_init(E2eMonitor *monitor) {
    memset(monitor, 0, sizeof *monitor);
}

static E2eVerdict judge(E2eMonitor *monitor, bool check, uint8_t counter) {
    if (!check || counter > E2E_COUNTER_MAX) {
        monitor->damaged++;
        return E2E_DAMAGED;
    }
    if (!monitor->seen)
        return E2E_FIRST;
    const uint8_t step = (uint8_t)((counter + COUNTERS - monitor->last) % COUNTERS);
    if (step == 0) {
        monitor->repeated++;
        return E2E_REPEATED;
    }
    if (step > 1 + E2E_LOST_MAX) {
        monitor->jumped++;
        return E2E_JUMPED;
    }
    monitor->lost += (uint32_t)(step - 1);
    return step == 1 ? E2E_GOOD : E2E_LOST;
}

E2eVerdict e2e_monitor_take(E2eMonitor *monitor, bool check, uint8_t counter) {
    const E2eVerdict verdict = judge(monitor, check, counter);
    if (verdict != E2E_DAMAGED) {
        monitor->last = counter;
        monitor->seen = true;
    }
    if (verdict != E2E_REPEATED)
        monitor->repeat = 0;
    else if (monitor->repeat < E2E_STUCK_AFTER && ++monitor->repeat == E2E_STUCK_AFTER)
        monitor->stuck++;
    monitor->bad = (uint8_t)((monitor->bad << 1 | (verdict >= E2E_REPEATED)) & WINDOW_MASK);
    return verdict;
}

bool e2e_monitor_trusts(const E2eMonitor *monitor) {
    int bad = 0;
    for (int i = 0; i < E2E_WINDOW; i++)
        bad += monitor->bad >> i & 1;
    return monitor->seen && bad < E2E_BAD_LIMIT;
}
