#include "tiled_sweep.h"

#include <stdlib.h>
#include <string.h>

#include "map_memory.h"
#include "parallel.h"

_Static_assert(TILE > 2 * (STEPS_MAX + 2), "a swap of one tile reaches STEPS_MAX + 1 cells, and one more is read");

/* Tiles of one colour that one thread sweeps: every `stride`th from `first` on. */
typedef struct {
    Tiling *tiling;
    const Sweep *sweep;
    size_t colour, first, stride;
    Sums before;
} Share;

bool tiling_open(Tiling *tiling, PlanSurface *surface, int32_t threads) {
    const size_t rows = (surface->nx + TILE - 1) / TILE, columns = (surface->ny + TILE - 1) / TILE;
    const size_t alike = ((rows + 1) / 2) * ((columns + 1) / 2);
    *tiling = (Tiling){.surface = surface, .rows = rows, .columns = columns};
    const size_t usable = alike < MAX_PARALLEL ? alike : MAX_PARALLEL;
    const size_t wanted = (size_t)threads < usable ? (size_t)threads : usable;
    tiling->awake = take_maps(surface->framed, 1);
    tiling->kept = take_maps(surface->problem->layers, surface->framed);
    tiling->tally = malloc(rows * columns * sizeof(Tally));
    tiling->stirred = malloc(rows * columns);
    tiling->window = calloc(wanted, sizeof(Window));
    tiling->bound = calloc(wanted, sizeof(ChangeBound));
    bool complete = flip_bounds_open(&tiling->flips, surface) && tiling->awake && tiling->kept && tiling->tally &&
                    tiling->stirred && tiling->window && tiling->bound;
    while (complete && tiling->threads < wanted) {
        complete = window_open(&tiling->window[tiling->threads], surface);
        complete = bound_open(&tiling->bound[tiling->threads], surface) && complete;
        tiling->threads++;
    }
    if (!complete)
        tiling_close(tiling);
    return complete;
}

void tiling_close(Tiling *tiling) {
    for (size_t k = 0; k < tiling->threads; k++) {
        window_close(&tiling->window[k]);
        bound_close(&tiling->bound[k]);
    }
    flip_bounds_close(&tiling->flips);
    free(tiling->bound);
    free(tiling->window);
    free(tiling->stirred);
    free(tiling->tally);
    give_maps(tiling->kept);
    give_maps(tiling->awake);
}

void tiling_wake(Tiling *tiling) {
    wake_all(tiling->surface, tiling->awake);
    flip_bounds_clear(&tiling->flips, tiling->surface);
    memset(tiling->stirred, MOVES_ALL, tiling->rows * tiling->columns);
}

static size_t tiles_of_colour(const Tiling *tiling, size_t colour) {
    return ((tiling->rows + 1 - colour / 2) / 2) * ((tiling->columns + 1 - colour % 2) / 2);
}

/* Index of tile number `k` of a colour. */
static size_t tile_index(const Tiling *tiling, size_t colour, size_t k) {
    const size_t columns = (tiling->columns + 1 - colour % 2) / 2;
    return (2 * (k / columns) + colour / 2) * tiling->columns + 2 * (k % columns) + colour % 2;
}

static Tile tile_at(const Tiling *tiling, size_t index) {
    const size_t top = TILE * (index / tiling->columns), left = TILE * (index % tiling->columns);
    const size_t nx = tiling->surface->nx, ny = tiling->surface->ny;
    return (Tile){top, top + TILE < nx ? top + TILE : nx, left, left + TILE < ny ? left + TILE : ny};
}

/* Marks the tile and those around it: a change may wake their cells. */
static void mark_stirred(Tiling *tiling, size_t index) {
    const size_t row = index / tiling->columns, column = index % tiling->columns;
    for (size_t i = row > 0 ? row - 1 : 0; i <= row + 1 && i < tiling->rows; i++)
        for (size_t j = column > 0 ? column - 1 : 0; j <= column + 1 && j < tiling->columns; j++)
            tiling->stirred[i * tiling->columns + j] = MOVES_ALL;
}

static void sweep_one(Tiling *tiling, const Sweep *sweep, size_t index, const Sums *before, size_t thread) {
    const Tile tile = tile_at(tiling, index);
    Tally *tally = &tiling->tally[index];
    Window *window = &tiling->window[thread];
    *tally = (Tally){0};
    if (sweep->move != MOVE_ANNEAL && !(tiling->stirred[index] & sweep->move))
        return;
    tiling->stirred[index] &= (uint8_t)~sweep->move; /* set again by the changes of its colour */
    if (tiling->rows * tiling->columns > 1)          /* the surface has changed elsewhere */
        bound_renew(&tiling->bound[thread]);
    if (tiling->surface->steps > 1 || sweep->move == MOVE_ANNEAL)
        tile_sweep(tiling->surface, tiling->awake, &tile, sweep, before, window, &tiling->bound[thread], tally);
    else if (sweep->move != MOVE_SHIFTS) /* there is no other layer */
        one_step_sweep(tiling->surface, tiling->awake, &tile, sweep, before, &tiling->flips, &window->work, tally);
}

static void *sweep_share(void *handed) {
    const Share *share = handed;
    const size_t tiles = tiles_of_colour(share->tiling, share->colour);
    for (size_t k = share->first; k < tiles; k += share->stride)
        sweep_one(share->tiling, share->sweep, tile_index(share->tiling, share->colour, k), &share->before,
                  share->first);
    return NULL;
}

/* Sweeps the tiles of a colour in parallel, each on the same sums. */
static void sweep_together(Tiling *tiling, const Sweep *sweep, size_t colour) {
    const size_t tiles = tiles_of_colour(tiling, colour);
    const size_t threads = tiling->threads < tiles ? tiling->threads : tiles;
    Share share[MAX_PARALLEL];
    for (size_t k = 0; k < threads; k++)
        share[k] = (Share){tiling, sweep, colour, k, threads, tiling->surface->sums};
    run_parallel(sweep_share, share, sizeof *share, threads);
}

/* Sums after the tiles of a colour, added in the order of the tiles. */
static Sums joined_sums(const Tiling *tiling, size_t colour) {
    Sums sums = tiling->surface->sums;
    for (size_t k = 0; k < tiles_of_colour(tiling, colour); k++)
        sums = sums_after(&sums, &tiling->tally[tile_index(tiling, colour, k)].change);
    return sums;
}

static bool is_out_of_time(const Tiling *tiling, size_t colour) {
    bool found = false;
    for (size_t k = 0; k < tiles_of_colour(tiling, colour); k++)
        found = found || tiling->tally[tile_index(tiling, colour, k)].out_of_time;
    return found;
}

static void sweep_in_turn(Tiling *tiling, const Sweep *sweep, size_t colour) {
    PlanSurface *surface = tiling->surface;
    for (size_t k = 0; k < tiles_of_colour(tiling, colour); k++) {
        const size_t index = tile_index(tiling, colour, k);
        sweep_one(tiling, sweep, index, &surface->sums, 0);
        surface->sums = sums_after(&surface->sums, &tiling->tally[index].change);
    }
}

static void sweep_colour(Tiling *tiling, const Sweep *sweep, size_t colour) {
    PlanSurface *surface = tiling->surface;
    const size_t values = surface->problem->layers * surface->framed;
    const Weighting *weighting = &surface->weighting;
    const bool separable =
        weighting->alpha == 1.0 || tiles_of_colour(tiling, colour) == 1 || sweep->move == MOVE_ANNEAL;
    if (!separable)
        memcpy(tiling->kept, surface->plan, values);
    sweep_together(tiling, sweep, colour);
    const Sums sums = joined_sums(tiling, colour);
    if (separable || objective(&sums, weighting) <= objective(&surface->sums, weighting)) {
        surface->sums = sums;
        return;
    }
    memcpy(surface->plan, tiling->kept, values);
    if (is_out_of_time(tiling, colour)) /* the search ends here, and evaluates its plan */
        return;
    surface_evaluate(surface);
    forget_tries(surface, tiling->awake);
    tiling_wake(tiling);
    sweep_in_turn(tiling, sweep, colour);
}

int64_t tiled_sweep(Tiling *tiling, const Sweep *sweep, SearchReport *report, bool *out_of_time) {
    int64_t changes = 0;
    *out_of_time = false;
    for (size_t colour = 0; colour < 4 && !*out_of_time; colour++) {
        const int64_t before = changes;
        sweep_colour(tiling, sweep, colour);
        for (size_t k = 0; k < tiles_of_colour(tiling, colour); k++) {
            const size_t index = tile_index(tiling, colour, k);
            const Tally *tally = &tiling->tally[index];
            report->evaluations += tally->evaluations;
            report->flips += tally->flips;
            report->swaps += tally->swaps;
            report->shifts += tally->shifts;
            if (tally->flips + tally->swaps + tally->shifts > 0)
                mark_stirred(tiling, index);
            changes += tally->flips + tally->swaps + tally->shifts;
            *out_of_time = *out_of_time || tally->out_of_time;
        }
        if (changes > before && tiling->surface->steps > 1) /* sweeps of a single step do not use the marks */
            forget_tries(tiling->surface, tiling->awake);
    }
    return changes;
}
