#include "one_step_sweep.h"

#include <math.h>
#include <string.h>

#include "instruction_sets.h"
#include "one_step_cells.h"
#include "stopwatch.h"

/* Cells printed between two looks at the clock: about a tenth of a millisecond (by trial). */
static const int64_t WORK_BETWEEN_LOOKS = 100000;

typedef struct {
    PlanSurface *surface;
    uint8_t *awake;
    const Sums *before;
    FlipBounds *flips;
    int64_t *work;
    Tally *tally;
    double deadline;   /* by the stopwatch [s] */
    int64_t next_look; /* value of `work` at the next look at the clock */
    bool cost_alone;
    FirstChange first;
} TileWork;

/* The sums that count, before a move. */
static inline Sums sums_of(const TileWork *work) {
    return work->cost_alone ? (Sums){0.0, 0.0, 0.0} : sums_after(work->before, &work->tally->change);
}

/* Change of the objective by a move; infinity where the cost alone counts and does not fall. */
static inline double cost_of(const TileWork *work, const Sums *sums, const Sums *added) {
    const Weighting *weighting = &work->surface->weighting;
    if (work->cost_alone && added->cost >= 0.0)
        return INFINITY; /* most moves do not help: no division for them */
    return work->cost_alone ? added->cost / weighting->count : objective_change(sums, added, weighting);
}

/* Sets a value of the plan; flip: cost of undoing it, NaN: unknown. */
static void set_value(TileWork *work, size_t i, size_t j, unsigned value, double flip) {
    surface_layer(work->surface, 0)[surface_cell(work->surface, i, j)] = (uint8_t)value;
    wake_near(work->surface, work->awake, i, j);
    flip_bounds_change(work->flips, work->surface, i, j, value, flip);
}

/* Tries another droplet, or none, on the cell. */
static void flip(TileWork *work, size_t i, size_t j) {
    PlanSurface *surface = work->surface;
    const size_t cell = surface_cell(surface, i, j);
    const unsigned own = surface_layer(surface, 0)[cell];
    const Sums sums = sums_of(work);
    double least = -surface->least_gain;
    unsigned best = own;
    CellChange change = {i, j, own, own};
    ChangedCells cells;
    for (unsigned other = 0; other < surface->problem->kinds; other++) {
        const unsigned value = other + (other >= own); /* no branch on the plan: branch prediction would fail */
        if (!surface_allows(surface, 0, i, j, value))
            continue;
        change.to = value;
        look_at_change(surface, &change, work->cost_alone, &cells);
        const double cost = cost_of(work, &sums, &cells.sums);
        *work->work += FOOTPRINT;
        work->tally->evaluations++;
        flip_bounds_put(work->flips, cell, cells.sums.cost); /* with bounds there is one other value only */
        if (cost < least) {
            least = cost;
            best = value;
        }
    }
    if (best == own)
        return;
    if (change.to != best) {
        change.to = best;
        look_at_change(surface, &change, work->cost_alone, &cells);
    }
    put_cells(surface, &change, &cells);
    work->tally->change = sums_after(&work->tally->change, &cells.sums);
    work->tally->flips++;
    set_value(work, i, j, best, -cells.sums.cost);
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

/* The neighbours that the cell's droplet may be swapped with, as k of FOOTPRINT, without those excluded by bounds;
 * returns their number. No branch on the plan, where branch prediction would fail. */
static size_t partners(const TileWork *work, size_t i, size_t j, unsigned own, size_t *partner) {
    const size_t nx = work->surface->nx, ny = work->surface->ny;
    if (i > 0 && i + 1 < nx && j > 0 && j + 1 < ny)
        return partners_among(work, i, j, own, (Around){0, 2, 0, 2}, partner);
    const Around around = {i > 0 ? 0 : 1, i + 1 < nx ? 2 : 1, j > 0 ? 0 : 1, j + 1 < ny ? 2 : 1};
    return partners_among(work, i, j, own, around, partner);
}

/* A swap with a neighbour. */
typedef struct {
    size_t i, j;
    unsigned other; /* the neighbour's value */
    double cost;    /* change of the objective [m] */
    Sums worth;
} Swap;

static void make_change(TileWork *work, size_t i, size_t j, unsigned from, unsigned to) {
    const CellChange change = {i, j, from, to};
    ChangedCells cells;
    look_at_change(work->surface, &change, true, &cells);
    put_cells(work->surface, &change, &cells);
    set_value(work, i, j, to, NAN);
}

/* First half of a swap: puts the other value on the cell; its own goes to a neighbour later. */
static void begin_swap(TileWork *work, size_t i, size_t j, unsigned own, unsigned other) {
    const CellChange change = {i, j, own, other};
    look_at_first(work->surface, &change, work->cost_alone, &work->first);
    flip_bounds_put(work->flips, surface_cell(work->surface, i, j),
                    work->first.sums.cost); /* with bounds the other value is 0 */
}

/* Tries to swap the cell's droplet with the value of a neighbour. */
static void swap(TileWork *work, size_t i, size_t j) {
    const PlanSurface *surface = work->surface;
    const uint8_t *plan = surface_layer(surface, 0);
    const unsigned own = plan[surface_cell(surface, i, j)];
    size_t partner[FOOTPRINT];
    const size_t count = own ? partners(work, i, j, own, partner) : 0;
    if (count == 0)
        return;
    const Sums sums = sums_of(work);
    Swap best = {.other = own, .cost = -surface->least_gain};
    unsigned given = own; /* value of the cell after the first change */
    for (size_t k = 0; k < count; k++) {
        const size_t row = partner[k] / 3, column = partner[k] % 3, its_i = i + row - 1, its_j = j + column - 1;
        const unsigned other = plan[surface_cell(surface, its_i, its_j)];
        if (other != given)
            begin_swap(work, i, j, own, other);
        given = other; /* the first change has also given the cost of the cell's flip: */
        if (is_swap_in_vain(work->flips, surface_cell(surface, i, j), surface_cell(surface, its_i, its_j), row != 1,
                            column != 1))
            continue;
        const CellChange change = {its_i, its_j, other, own};
        const Sums added = look_at_second(surface, &work->first, near_of(row, column), &change, work->cost_alone);
        const double cost = cost_of(work, &sums, &added);
        if (cost < best.cost)
            best = (Swap){its_i, its_j, other, cost, added};
    }
    *work->work += (int64_t)count * FOOTPRINT;
    work->tally->evaluations += (int64_t)count;
    if (best.other == own)
        return;
    make_change(work, i, j, own, best.other);
    make_change(work, best.i, best.j, best.other, own);
    work->tally->change = sums_after(&work->tally->change, &best.worth);
    work->tally->swaps++;
}

enum { WORD = 8 };        /* cells tested together */
enum { FELT_BEHIND = 4 }; /* cells behind one whose move was made that it may affect */

/* The first cell of the row from k on with any of the bits, or `count`. */
static size_t next_with(const uint8_t *cells, uint8_t bits, size_t k, size_t count) {
    const uint64_t wanted = bits * UINT64_C(0x0101010101010101);
    for (; k + WORD <= count; k += WORD) {
        uint64_t word;
        memcpy(&word, cells + k, WORD);
        if (word & wanted)
            break;
    }
    while (k < count && !(cells[k] & bits))
        k++;
    return k;
}

static void put_to_sleep(uint8_t *awake, size_t count, uint8_t move) {
    for (size_t k = 0; k < count; k++)
        awake[k] &= (uint8_t)~move;
}

static bool is_out_of_time(TileWork *work) {
    if (*work->work >= work->next_look) {
        work->next_look = *work->work + WORK_BETWEEN_LOOKS;
        work->tally->out_of_time = stopwatch_seconds() >= work->deadline;
    }
    return work->tally->out_of_time;
}

static inline int64_t moves_made(const TileWork *work) {
    return work->tally->flips + work->tally->swaps;
}

/* Tries the move on the cells of a row that are awake for it; false if the time has ended. */
static bool sweep_row(TileWork *work, size_t i, const Tile *tile, uint8_t move) {
    const size_t cell = surface_cell(work->surface, i, tile->left), count = tile->right - tile->left;
    uint8_t *awake = work->awake + cell, open[TILE];
    size_t done = next_with(awake, move, 0, count);
    if (done == count)
        return true;
    flip_bounds_mark(work->flips, work->surface, cell, count, work->awake, move, open);
    for (size_t k = done; (k = next_with(open, move, k, count)) < count; k++) {
        const int64_t made = moves_made(work);
        put_to_sleep(awake + done, k + 1 - done, move);
        done = k + 1;
        if (move == MOVE_FLIPS && is_flip_in_vain(work->flips, cell + k))
            continue;
        if (is_out_of_time(work))
            return false;
        if (move == MOVE_FLIPS)
            flip(work, i, tile->left + k);
        else
            swap(work, i, tile->left + k);
        if (moves_made(work) > made)
            memcpy(open + done, awake + done, FELT_BEHIND < count - done ? FELT_BEHIND : count - done);
    }
    put_to_sleep(awake + done, count - done, move);
    return true;
}

static void sweep_tile(TileWork *work, const Tile *tile, uint8_t move) {
    if (move == MOVE_SWAPS)
        flip_bounds_renew(work->flips, work->surface, tile, work->awake, MOVE_SWAPS);
    for (size_t i = tile->top; i < tile->bottom; i++) {
        const Tile row = {i, i + 1, tile->left, tile->right};
        if (move == MOVE_FLIPS)
            flip_bounds_renew(work->flips, work->surface, &row, work->awake, MOVE_FLIPS);
        if (!sweep_row(work, i, tile, move))
            return;
    }
}

/* Sweeps the tile until the move helps nowhere, or the time has ended. */
static void repeat(TileWork *work, const Tile *tile, uint8_t move) {
    for (int64_t made = -1; moves_made(work) > made && !work->tally->out_of_time;) {
        made = moves_made(work);
        sweep_tile(work, tile, move);
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
    work.deadline = sweep->deadline;
    work.next_look = *cells_printed;
    work.tally = tally;
    work.cost_alone = is_cost_enough(surface);
    first_open(&work.first);
    for (int64_t made = -1; moves_made(&work) > made && !tally->out_of_time;) {
        made = moves_made(&work);
        if (sweep->move & MOVE_FLIPS)
            repeat(&work, tile, MOVE_FLIPS);
        if (sweep->move & MOVE_SWAPS)
            repeat(&work, tile, MOVE_SWAPS);
    }
}
