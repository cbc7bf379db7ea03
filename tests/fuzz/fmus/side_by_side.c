/* Instances of one library at the same time, each in a thread of its own, print other layers; then the same one after
 * the other, which must end in the same states. For the thread sanitizer, and with the others a whole life without a
 * leak. The FMU is the one of the table named as the only argument. */
#include "events.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

enum { INSTANCES = 4, LAYERS = 12 };

typedef struct {
    const Fmu *fmu;
    unsigned seed;
    Saved end;
} Print;

/* A life from the first call to the last, with a refused call after each layer. */
static void *print(void *argument) {
    Print *print = argument;
    const Variable *seed = fmu_variable(print->fmu, "seed", 'p');
    const Variable *printer = fmu_variable(print->fmu, "printer_seed", 'p');
    const Variable *volume = fmu_variable(print->fmu, "volume_factor", 'i');
    const double number = print->seed, share = 1.0 / (1.0 + number);
    Subject s;
    subject_open(&s, print->fmu);
    if (seed)
        subject_set(&s, seed, &number, 1);
    else if (printer)
        subject_set(&s, printer, &number, 1);
    else if (volume)
        subject_set(&s, volume, &share, 1);
    subject_enter(&s, 0.0);
    Input none = {NULL, 0};
    demand(&s, "exit", subject_exit(&s), "it begins");
    for (unsigned layer = 0; layer < LAYERS; layer++) {
        demand(&s, "event", events_handle(&s, &none, true), "events are handled");
        demand(&s, "offer", subject_offer(&s, 16 * print->seed + layer + 1), "inputs are taken");
        demand(&s, "step", subject_step(&s, s.now, 10.0), "a step is taken");
        subject_step(&s, s.now, -1.0);
    }
    print->end = subject_save(&s);
    subject_terminate(&s);
    subject_close(&s);
    return NULL;
}

int main(int count, char **arguments) {
    static Fmu fmu;
    fmu_open(&fmu, count == 2 ? arguments[1] : NULL);
    Print together[INSTANCES], alone[INSTANCES];
    pthread_t threads[INSTANCES];
    for (unsigned k = 0; k < INSTANCES; k++) {
        together[k] = alone[k] = (Print){&fmu, k + 1, {NULL, 0}};
        if (pthread_create(&threads[k], NULL, print, &together[k]) != 0)
            return 2;
    }
    for (unsigned k = 0; k < INSTANCES; k++)
        pthread_join(threads[k], NULL);
    for (unsigned k = 0; k < INSTANCES; k++)
        print(&alone[k]);
    bool same = true, differ = true;
    for (unsigned k = 0; k < INSTANCES; k++) {
        same = same && is_same(&together[k].end, &alone[k].end);
        differ = differ && (k == 0 || !is_same(&alone[k - 1].end, &alone[k].end));
    }
    for (unsigned k = 0; k < INSTANCES; k++) {
        free(together[k].end.bytes);
        free(alone[k].end.bytes);
    }
    if (!same || !differ)
        fprintf(stderr, "%s\n", same ? "all instances print the same" : "together is not as one after the other");
    return same && differ ? 0 : 1;
}
