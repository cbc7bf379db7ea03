#include "one_step_sweep.h"

#include <math.h>
#include <string.h>

#include "instruction_sets.h"
#include "one_step.h"
#include "one_step_cells.h"
#include "stopwatch.h"

/* Cells printed between two looks at the clock: about a tenth of a millisecond (by trial). */
static const int64_t WORK_BETWEEN_LOOKS = 100000;

enum { SHARE_ROWS = 3, SHARE_COLUMNS = TILE + 2 }; /* of a tile and the cells around it */

/* What droplets give to the cells around them, kept for the rows that a sweep is at. */
typedef struct {
    size_t row[SHARE_COLUMNS];     /* of the grid; SIZE_MAX: none */
    unsigned value[SHARE_COLUMNS]; /* of a plan */
    double shares[SHARE_COLUMNS][THREE];
} ShareRow;

typedef struct {
    PlanSurface *surface;
    uint8_t *awake;
    const Sums *before;
    FlipBounds *flips;
    int64_t *work;
    Tally *tally;
    bool cost_alone;
    size_t left; /* column of the tile */
    FirstChange first;
    double gone[THREE];
    ShareRow row[SHARE_ROWS];
} TileWork;

/* What a droplet of this value on cell (i, j) gives. */
static const double *kept_shares(TileWork *work, size_t i, size_t j, unsigned value) {
    ShareRow *row = &work->row[i % SHARE_ROWS];
    const size_t column = j + 1 - work->left;
    if (row->row[column] != i || row->value[column] != value) {
        take_shares(work->surface, i * work->surface->stride + j, value, row->shares[column]);
        row->row[column] = i;
        row->value[column] = value;
    }
    return row->shares[column];
}

/* The change of cell (i, j) from one value to another, until the next one. */
static CellsChange change_of(TileWork *work, size_t i, size_t j, unsigned from, unsigned to) {
    CellsChange change = {i * work->surface->stride + j, NO_SHARES, NO_SHARES};
    if (from)
        change.gone = kept_shares(work, i, j, from);
    if (from && to) /* the new droplet's are kept in the same place */
        change.gone = memcpy(work->gone, change.gone, sizeof work->gone);
    if (to)
        change.come = kept_shares(work, i, j, to);
    return change;
}

/* The best changes tried so far. */
typedef struct {
    Change change[CHANGES_MAX];
    size_t count;
    Sums worth;
    double cost; /* what they do to the objective [m] */
} Best;

/* The sums before a move, as far as they count. */
static inline Sums sums_of(const TileWork *work) {
    return work->cost_alone ? (Sums){0.0, 0.0, 0.0} : sums_after(work->before, &work->tally->change);
}

/* What a change does to the objective; infinity where the cost alone counts and falls by nothing. */
static inline double cost_of(const TileWork *work, const Sums *sums, const Sums *added) {
    const Weighting *weighting = &work->surface->weighting;
    if (work->cost_alone && added->cost >= 0.0)
        return INFINITY; /* most are in vain: no division for them */
    return work->cost_alone ? added->cost / weighting->count : objective_change(sums, added, weighting);
}

static Best no_better(const TileWork *work) {
    return (Best){.cost = -work->surface->least_gain};
}

static void make(TileWork *work, const Best *best) {
    PlanSurface *surface = work->surface;
    one_step_apply(surface, best->change, best->count);
    work->tally->change = sums_after(&work->tally->change, &best->worth);
    for (size_t k = 0; k < best->count; k++) {
        const Change *change = &best->change[k];
        surface_layer(surface, 0)[surface_cell(surface, change->i, change->j)] = (uint8_t)change->value;
        wake_near(surface, work->awake, change->i, change->j);
        flip_bounds_change(work->flips, surface, change->i, change->j, change->value,
                           best->count == 1 ? -best->worth.cost : NAN);
    }
}

/* Another droplet, or none, on the cell. */
static void flip(TileWork *work, size_t i, size_t j) {
    const PlanSurface *surface = work->surface;
    const size_t cell = surface_cell(surface, i, j);
    const unsigned own = surface_layer(surface, 0)[cell];
    if (is_flip_in_vain(work->flips, cell))
        return;
    const Sums sums = sums_of(work);
    Best best = no_better(work);
    for (unsigned value = 0; value <= surface->problem->kinds; value++) {
        if (value == own || !surface_allows(surface, 0, i, j, value))
            continue;
        const CellsChange change = change_of(work, i, j, own, value);
        const Sums added = look_at_change(surface, &change, work->cost_alone);
        const double cost = cost_of(work, &sums, &added);
        *work->work += FOOTPRINT;
        work->tally->evaluations++;
        flip_bounds_put(work->flips, cell, added.cost); /* there is no other one if there are bounds */
        if (cost < best.cost)
            best = (Best){{{0, i, j, value}}, 1, added, cost};
    }
    if (best.count) {
        make(work, &best);
        work->tally->flips++;
    }
}

/* The rows and columns of neighbours that are on the grid, 0 to 2 for -1 to 1. */
typedef struct {
    size_t top, bottom, left, right;
} Around;

static INLINED size_t partners_among(const TileWork *work, size_t i, size_t j, unsigned own, const Around around,
                                     size_t *partner) {
    const PlanSurface *surface = work->surface;
    const float *least = work->flips->least, sure = work->flips->sure;
    const float losses[3] = {0.0f, work->flips->loss[0][1] + sure, work->flips->loss[1][1] + sure};
    const size_t cell = surface_cell(surface, i, j), place = i * surface->ny + j;
    const uint8_t *plan = surface_layer(surface, 0);
    const uint16_t *choices = surface->problem->choices;
    const unsigned own_choices = 2u * choices[place] + 1u;
    const float own_least = least ? least[cell] : NAN;
    size_t count = 0;
    for (size_t row = around.top; row <= around.bottom; row++)
        for (size_t column = around.left; column <= around.right; column++) {
            const size_t its_cell = cell + row * surface->stride + column - surface->stride - 1;
            const unsigned other = plan[its_cell];
            const unsigned its_choices = 2u * choices[place + row * surface->ny + column - surface->ny - 1] + 1u;
            const bool in_vain = least && own_least + least[its_cell] > losses[(row != 1) + (column != 1)];
            partner[count] = 3 * row + column;
            count += (other != own) & (its_choices >> own) & (own_choices >> other) & !in_vain;
        }
    return count;
}

/* The neighbours that the cell's droplet may be swapped with, as k of FOOTPRINT, without those that certainly are in
 * vain; returns how many. Without a branch on the plan, which no processor could predict. */
static size_t partners(const TileWork *work, size_t i, size_t j, unsigned own, size_t *partner) {
    const size_t nx = work->surface->nx, ny = work->surface->ny;
    if (i > 0 && i + 1 < nx && j > 0 && j + 1 < ny)
        return partners_among(work, i, j, own, (Around){0, 2, 0, 2}, partner);
    const Around around = {i > 0 ? 0 : 1, i + 1 < nx ? 2 : 1, j > 0 ? 0 : 1, j + 1 < ny ? 2 : 1};
    return partners_among(work, i, j, own, around, partner);
}

/* Puts another droplet, or none, on the cell before its own goes to a neighbour. */
static void begin_swap(TileWork *work, size_t i, size_t j, unsigned own, unsigned other) {
    const CellsChange change = change_of(work, i, j, own, other);
    look_at_first(work->surface, &change, work->cost_alone, &work->first);
    flip_bounds_put(work->flips, surface_cell(work->surface, i, j),
                    work->first.sums.cost); /* the other is 0 if there are bounds */
}

/* The cell's droplet against what one of its neighbours has. */
static void swap(TileWork *work, size_t i, size_t j) {
    const PlanSurface *surface = work->surface;
    const uint8_t *plan = surface_layer(surface, 0);
    const unsigned own = plan[surface_cell(surface, i, j)];
    size_t partner[FOOTPRINT];
    const size_t count = own ? partners(work, i, j, own, partner) : 0;
    if (count == 0)
        return;
    const Sums sums = sums_of(work);
    Best best = no_better(work);
    unsigned given = own; /* what the cell gets by the first change */
    for (size_t k = 0; k < count; k++) {
        const size_t row = partner[k] / 3, column = partner[k] % 3, its_i = i + row - 1, its_j = j + column - 1;
        const unsigned other = plan[surface_cell(surface, its_i, its_j)];
        if (other != given)
            begin_swap(work, i, j, own, other);
        given = other; /* and while the cell's flip has become known: */
        if (is_swap_in_vain(work->flips, surface_cell(surface, i, j), surface_cell(surface, its_i, its_j), row != 1,
                            column != 1))
            continue;
        const CellsChange change = change_of(work, its_i, its_j, other, own);
        const Sums added = look_at_second(surface, &work->first, near_of(row, column), &change, work->cost_alone);
        const double cost = cost_of(work, &sums, &added);
        if (cost < best.cost)
            best = (Best){{{0, i, j, other}, {0, its_i, its_j, own}}, 2, added, cost};
    }
    *work->work += (int64_t)count * FOOTPRINT;
    work->tally->evaluations += (int64_t)count;
    if (best.count) {
        make(work, &best);
        work->tally->swaps++;
    }
}

enum { WORD = 8 }; /* cells whose bits are looked at together */

/* The first cell of the row from j on where the move may have begun to help; `right`: there is none. */
static size_t next_awake(const uint8_t *awake, uint8_t move, size_t j, size_t right) {
    const uint64_t wanted = move * UINT64_C(0x0101010101010101);
    for (; j + WORD <= right; j += WORD) {
        uint64_t cells;
        memcpy(&cells, awake + j, WORD);
        if (cells & wanted)
            break;
    }
    while (j < right && !(awake[j] & move))
        j++;
    return j;
}

static void sweep_tile(TileWork *work, const Tile *tile, const Sweep *sweep) {
    const uint8_t move = (uint8_t)sweep->move;
    int64_t next_look = *work->work;
    for (size_t i = tile->top; i < tile->bottom; i++) {
        uint8_t *awake = work->awake + surface_cell(work->surface, i, 0);
        for (size_t j = tile->left; (j = next_awake(awake, move, j, tile->right)) < tile->right; j++) {
            if (*work->work >= next_look) {
                next_look = *work->work + WORK_BETWEEN_LOOKS;
                work->tally->out_of_time = stopwatch_seconds() >= sweep->deadline;
                if (work->tally->out_of_time)
                    return;
            }
            awake[j] &= (uint8_t)~move;
            if (move == MOVE_FLIPS)
                flip(work, i, j);
            else
                swap(work, i, j);
        }
    }
}

void one_step_sweep(PlanSurface *surface, uint8_t *awake, const Tile *tile, const Sweep *sweep, const Sums *before,
                    FlipBounds *flips, int64_t *cells_printed, Tally *tally) {
    TileWork work;
    work.surface = surface;
    work.awake = awake;
    work.before = before;
    work.flips = flips;
    work.work = cells_printed;
    work.tally = tally;
    work.cost_alone = is_cost_enough(surface);
    work.left = tile->left;
    first_open(&work.first);
    flip_bounds_read(flips, surface, tile);
    for (size_t k = 0; k < SHARE_ROWS; k++)
        memset(work.row[k].row, UINT8_MAX, sizeof work.row[k].row);
    sweep_tile(&work, tile, sweep);
}
