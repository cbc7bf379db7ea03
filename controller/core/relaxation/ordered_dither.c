#include "ordered_dither.h"

#include "drop_levels.h"

enum { SIDE_OF_PATTERN = 4, THRESHOLDS = SIDE_OF_PATTERN * SIDE_OF_PATTERN };

/* Thresholds of Bayer (1973): each next droplet falls as far as possible from those before. */
static const int ORDER[SIDE_OF_PATTERN][SIDE_OF_PATTERN] = {
    {0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};

void dither_droplets(const HorizonProblem *problem, const double *droplets, int32_t *plan) {
    for (size_t i = 0; i < problem->nx; i++)
        for (size_t j = 0; j < problem->ny; j++) {
            const size_t cell = i * problem->ny + j;
            const double threshold = (ORDER[i % SIDE_OF_PATTERN][j % SIDE_OF_PATTERN] + 0.5) / THRESHOLDS;
            const uint8_t kind = first_kind(problem, problem->choices[cell]);
            plan[cell] = kind != NO_KIND && droplets[cell] > threshold ? 1 + kind : 0;
        }
}
