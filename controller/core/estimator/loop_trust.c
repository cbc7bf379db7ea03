#include "loop_trust.h"

#include <math.h>
#include <string.h>

#include "small_algebra.h"

static const double GROUND_TOLERANCE = 0.5; /* of a layer: flatter ground is called flat (assumed) */
static const double GROUND_DOUBT = 6.0;     /* standard errors of the plane (assumed) */
static const double DEVIATION_MAX = 0.15;   /* droplets that vary by 40 % show 0.13; what is more is the model's */
static const double MODEL_MAX = 0.3;        /* (by trial) */
static const double FOREIGN = 5.0;          /* early residuals that are the model's: droplets that vary by 40 % show
                                               2.8, caps of droplets 3.0, surface tension 7 to 10 (by trial) */
static const double RESIDUALS_MAX = 9.0;    /* droplets that vary by 40 % show 3.3, surface tension 18 (by trial) */
static const double SPILL_MAX = 6.0;        /* droplets that vary by 40 % show up to 2.4; no flow 14, wider droplets 10,
                                               surface tension 14, caps of droplets 56 in their first layers (by trial) */
static const double FORGETTING = 0.8;       /* weight of a layer against the next, as of the ink */
static const double MEDIAN_SQUARE = 0.4549; /* of a normal variable of variance 1 */
static const double UNIFORM_MEDIAN_SQUARE = 0.75; /* of a uniform one */
static const double MOST = 0.5;                   /* of the part (assumed) */
static const double WEAK = 0.5;                   /* of a volume: less is ink that has run out (assumed) */
static const double BLIND = 0.5;                  /* share of the part (assumed) */
static const double MISFIT_MAX = 5.0;             /* more is no droplet (assumed) */
enum { TERMS = 3, LEAST_CELLS = 8, LEAST_DROPLETS = 20 };

LoopTrust full_trust(void) {
    return (LoopTrust){.early = 1.0, .residual = 1.0, .volume = 1.0, .usual = 1.0, .spill = 1.0};
}

int32_t untrusted_reasons(const LoopTrust *trust) {
    return (trust->unseen_cells > 0 ? UNTRUSTED_UNSEEN : 0) | (trust->blind_share > BLIND ? UNTRUSTED_BLIND : 0) |
           (trust->ground_wrong ? UNTRUSTED_GROUND : 0) | (trust->residual > RESIDUALS_MAX ? UNTRUSTED_RESIDUALS : 0) |
           (trust->capped_cells > 0 ? UNTRUSTED_INK : 0) | (trust->high_cells > 0 ? UNTRUSTED_HIGH : 0);
}

/* From -0.5 to 0.5 over the grid. */
static double place(size_t at, size_t count) {
    return count > 1 ? (double)at / (double)(count - 1) - 0.5 : 0.0;
}

static void terms_of(size_t nx, size_t ny, size_t cell, double term[TERMS]) {
    term[0] = 1.0;
    term[1] = place(cell / ny, nx);
    term[2] = place(cell % ny, ny);
}

/* Least squares of the first `terms` terms; the number of cells. */
static size_t fit_ground(size_t nx, size_t ny, const double *scan, const uint8_t *valid, size_t terms,
                         double plane[TERMS], double *variance) {
    double matrix[TERMS * TERMS] = {0.0}, side[TERMS] = {0.0}, squares = 0.0;
    size_t count = 0;
    for (size_t cell = 0; cell < nx * ny; cell++) {
        double term[TERMS];
        if (!valid[cell])
            continue;
        terms_of(nx, ny, cell, term);
        for (size_t i = 0; i < terms; i++) {
            side[i] += term[i] * scan[cell];
            for (size_t j = 0; j < terms; j++)
                matrix[i * terms + j] += term[i] * term[j];
        }
        count++;
    }
    memset(plane, 0, TERMS * sizeof *plane);
    if (count < LEAST_CELLS || !solve_definite(terms, matrix, side))
        return 0;
    memcpy(plane, side, terms * sizeof *plane);
    for (size_t cell = 0; cell < nx * ny; cell++) {
        double term[TERMS];
        terms_of(nx, ny, cell, term);
        const double rest = scan[cell] - plane[0] - plane[1] * term[1] - plane[2] * term[2];
        squares += valid[cell] ? rest * rest : 0.0;
    }
    *variance = squares / (double)count;
    return count;
}

void compare_ground(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double layer, LoopTrust *trust) {
    double variance = 0.0;
    size_t count = fit_ground(nx, ny, scan, valid, TERMS, trust->ground, &variance);
    if (count == 0) /* a line of cells, or hardly any */
        count = fit_ground(nx, ny, scan, valid, 1, trust->ground, &variance);
    if (count == 0)
        return;
    /* of a plane over a grid the corner, with the variance of three terms, of 1, 12 and 12 cells each, at 0.5 */
    const double error = sqrt(variance * 7.0 / (double)count);
    const double corner = fabs(trust->ground[0]) + 0.5 * fabs(trust->ground[1]) + 0.5 * fabs(trust->ground[2]);
    trust->ground_wrong = corner > fmax(GROUND_TOLERANCE * layer, GROUND_DOUBT * error);
}

double learn_volume(const ValueLists *shares, size_t count, size_t part_cells, double learnt, double *room,
                    LoopTrust *trust) {
    trust->volume = trust->usual / learnt;
    if (count < LEAST_DROPLETS)
        return trust->volume;
    const double volume = median_of_lists(shares, room);
    if ((double)count > MOST * (double)part_cells) {
        trust->volume = fmax(0.0, volume);
        if (volume > WEAK)
            trust->usual = FORGETTING * trust->usual + (1.0 - FORGETTING) * volume * learnt;
    }
    return volume;
}

bool add_residuals(const ValueLists *squares, size_t count, bool is_early, double *room, LoopTrust *trust) {
    if (count < LEAST_DROPLETS)
        return false;
    const double found = median_of_lists(squares, room) / MEDIAN_SQUARE;
    trust->layers += 1;
    trust->residual = FORGETTING * trust->residual + (1.0 - FORGETTING) * found;
    if (is_early)
        trust->early += (found - trust->early) / (double)trust->layers;
    return true;
}

void add_spill(const ValueLists *squares, size_t count, double variance, double *room, LoopTrust *trust) {
    if (count < LEAST_DROPLETS)
        return;
    const double found = median_of_lists(squares, room) / (MEDIAN_SQUARE * variance);
    trust->spill = FORGETTING * trust->spill + (1.0 - FORGETTING) * found;
}

bool is_plant_foreign(const LoopTrust *trust) {
    return trust->spill > SPILL_MAX;
}

double droplet_misfit(const LoopTrust *trust) {
    return fmin(MISFIT_MAX, fmax(1.0, sqrt(trust->early)));
}

double droplet_deviation(const LoopTrust *trust, double assumed) {
    const double found = assumed * sqrt(trust->residual * MEDIAN_SQUARE / UNIFORM_MEDIAN_SQUARE);
    if (trust->early > FOREIGN) /* no longer uniform */
        return fmin(assumed * sqrt(trust->early), MODEL_MAX);
    return trust->layers > 0 ? fmin(found, DEVIATION_MAX) : 0.0;
}
