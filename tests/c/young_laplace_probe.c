/* The kernels of YoungLaplaceDeposition for tests that load them with ctypes. */
#include "banded_cholesky.h"
#include "line_pass.h"

#include <stdlib.h>

/* Passes over lines first[k], first[k] + every[k], ... on the surface; counts per pass; false without memory. */
bool probe_print(const FineSurface *surface, const Liquid *liquid, const double *drops, size_t passes,
                 const size_t *first, const size_t *every, PassReport *reports) {
    PassMemory memory;
    void *block = malloc(place_pass_memory(surface, NULL, &memory));
    if (!block)
        return false;
    place_pass_memory(surface, block, &memory);
    for (size_t k = 0; k < passes; k++)
        reports[k] = print_pass(surface, liquid, drops, first[k], every[k], &memory);
    free(block);
    return true;
}
