#include "tile_moves.h"

#include <string.h>

#include "counter_random.h"
#include "stopwatch.h"

/* Cells printed between two looks at the clock: about a tenth of a millisecond (by trial). */
static const int64_t WORK_BETWEEN_LOOKS = 20000;

/* Distance within which a change wakes moves. Over one step it has no further effect: a swap reads the cells within 2
 * and a change alters those within 1. Over more steps a last sweep over all cells covers the rest (by trial). */
enum { WAKE_REACH = 3 };

static const double EXP_ROUNDED = 1.0 + 1e-12; /* bound of the relative rounding of an exponential in any C library */

typedef struct {
    PlanSurface *surface;
    uint8_t *awake;
    const Sweep *sweep;
    const Sums *before;
    Window *window;
    ChangeBound *bound;
    Tally *tally;
    int64_t next_look;
} Work;

/* The best move tried so far. */
typedef struct {
    Change change[CHANGES_MAX];
    size_t count;
    Sums worth;  /* see plan_trial_worth */
    double cost; /* change of the objective [m] */
} Best;

/* Whether the changes certainly do not lower the objective by more than `cost`. */
static bool is_in_vain(Work *work, const Change *change, size_t count, const Sums *sums, double cost) {
    work->window->work += NEAR_ROWS;
    return change_bound(work->bound, work->surface, change->i, change->j, change, count, sums) >= cost;
}

static void consider(Work *work, const Change *change, size_t count, Best *best) {
    const Sums sums = sums_after(work->before, &work->tally->change);
    work->tally->evaluations++;
    if (best->cost < 0.0 && is_in_vain(work, change, count, &sums, best->cost))
        return;
    const Sums added = plan_trial_worth(work->surface, change, count, work->window);
    const double cost = objective_change(&sums, &added, &work->surface->weighting);
    if (cost >= best->cost)
        return;
    best->count = count;
    best->worth = added;
    best->cost = cost;
    memcpy(best->change, change, count * sizeof(Change));
}

void wake_all(const PlanSurface *surface, uint8_t *awake) {
    for (size_t cell = 0; cell < surface->framed; cell++)
        awake[cell] |= MOVES_ALL;
}

void forget_tries(const PlanSurface *surface, uint8_t *awake) {
    for (size_t cell = 0; cell < surface->framed; cell++)
        awake[cell] &= MOVES_ALL;
}

void wake_near(const PlanSurface *surface, uint8_t *awake, size_t i, size_t j) {
    const size_t top = i > WAKE_REACH ? i - WAKE_REACH : 0, left = j > WAKE_REACH ? j - WAKE_REACH : 0;
    const size_t bottom = i + WAKE_REACH < surface->nx ? i + WAKE_REACH : surface->nx - 1;
    const size_t right = j + WAKE_REACH < surface->ny ? j + WAKE_REACH : surface->ny - 1;
    for (size_t row = top; row <= bottom; row++) {
        uint8_t *near = awake + surface_cell(surface, row, left);
        if (right - left == 2 * WAKE_REACH) /* a constant length compiles to two instructions */
            memset(near, MOVES_ALL, 2 * WAKE_REACH + 1);
        else
            memset(near, MOVES_ALL, right - left + 1);
    }
}

static void make(Work *work, const Best *best) {
    const bool is_whole = !is_cost_enough(work->surface);
    const Sums added = is_whole ? best->worth : plan_trial(work->surface, best->change, best->count, work->window);
    const Box changed = plan_apply(work->surface, best->change, best->count, work->window);
    bound_change(work->bound, work->surface, &changed);
    work->tally->change = sums_after(&work->tally->change, &added);
    for (size_t k = 0; k < best->count; k++)
        wake_near(work->surface, work->awake, best->change[k].i, best->change[k].j);
}

static unsigned value_at(const Work *work, size_t layer, size_t i, size_t j) {
    return surface_layer(work->surface, layer)[surface_cell(work->surface, i, j)];
}

static Best no_better(const Work *work) {
    return (Best){.cost = -work->surface->least_gain};
}

/* Tries another droplet, or none, on the cell in this layer. */
static void flip(Work *work, size_t layer, size_t i, size_t j) {
    const unsigned own = value_at(work, layer, i, j);
    Best best = no_better(work);
    for (unsigned value = 0; value <= work->surface->problem->kinds; value++) {
        const Change change = {layer, i, j, value};
        if (value != own && surface_allows(work->surface, layer, i, j, value))
            consider(work, &change, 1, &best);
    }
    if (best.count) {
        make(work, &best);
        work->tally->flips++;
    }
}

/* Tries to swap the cell's droplet with the value of a neighbour in the same layer. */
static void swap(Work *work, size_t layer, size_t i, size_t j) {
    const PlanSurface *surface = work->surface;
    const unsigned own = value_at(work, layer, i, j);
    Best best = no_better(work);
    for (size_t k = 0; own && k < FOOTPRINT; k++) {
        const size_t row = i + k / 3, column = j + k % 3; /* neighbour's row and column plus one: no wrap at 0 */
        if (row < 1 || row > surface->nx || column < 1 || column > surface->ny)
            continue;
        const unsigned other = value_at(work, layer, row - 1, column - 1);
        const Change change[2] = {{layer, i, j, other}, {layer, row - 1, column - 1, own}};
        if (other != own && surface_allows(surface, layer, i, j, other) &&
            surface_allows(surface, layer, row - 1, column - 1, own))
            consider(work, change, 2, &best);
    }
    if (best.count) {
        make(work, &best);
        work->tally->swaps++;
    }
}

/* Tries to exchange the cell's droplet with its value in another layer. */
static void shift(Work *work, size_t layer, size_t i, size_t j) {
    const PlanSurface *surface = work->surface;
    const unsigned own = value_at(work, layer, i, j);
    Best best = no_better(work);
    for (size_t other_layer = 0; own && other_layer < surface->problem->layers; other_layer++) {
        const unsigned other = value_at(work, other_layer, i, j);
        const Change change[2] = {{layer, i, j, other}, {other_layer, i, j, own}};
        if (other != own && surface_allows(surface, layer, i, j, other) &&
            surface_allows(surface, other_layer, i, j, own))
            consider(work, change, 2, &best);
    }
    if (best.count) {
        make(work, &best);
        work->tally->shifts++;
    }
}

/* Proposes another droplet on the cell in this layer, drawn from all allowed there; false: there is none. */
static bool draw_flip(const Work *work, size_t layer, size_t i, size_t j, uint64_t draw, Change *change) {
    const unsigned own = value_at(work, layer, i, j);
    unsigned other[KINDS_MAX];
    uint64_t others = 0;
    for (unsigned value = 0; value <= work->surface->problem->kinds; value++)
        if (value != own && surface_allows(work->surface, layer, i, j, value))
            other[others++] = value;
    if (others)
        *change = (Change){layer, i, j, other[random_below(work->sweep->key, draw, others)]};
    return others > 0;
}

/* Proposes to exchange the values of the cell in this layer and in another one, which is drawn; false: they are
 * equal. */
static bool draw_shift(const Work *work, size_t layer, size_t i, size_t j, uint64_t draw, Change change[2]) {
    const size_t layers = work->surface->problem->layers;
    const size_t other = (layer + 1 + (size_t)random_below(work->sweep->key, draw, layers - 1)) % layers;
    change[0] = (Change){layer, i, j, value_at(work, other, i, j)};
    change[1] = (Change){other, i, j, value_at(work, layer, i, j)};
    return change[0].value != change[1].value && surface_allows(work->surface, layer, i, j, change[0].value) &&
           surface_allows(work->surface, other, i, j, change[1].value);
}

/* Whether annealing certainly rejects the changes for the number `drawn`, by the lower bound of their cost. */
static bool is_declined(Work *work, const Change *change, size_t count, double drawn) {
    const Sums sums = sums_after(work->before, &work->tally->change);
    const double least = change_bound(work->bound, work->surface, change->i, change->j, change, count, &sums);
    const bool found = least > 0.0 && drawn > EXP_ROUNDED * exp(-least / work->sweep->temperature);
    work->window->work += NEAR_ROWS;
    work->tally->evaluations += found;
    return found;
}

/* A random change of the cell in this layer, made if it helps and sometimes if it does not (Metropolis). With more
 * layers every second one is a shift: the layer of a droplet matters less than the droplet itself. */
static void anneal(Work *work, size_t layer, size_t i, size_t j) {
    const uint64_t key = work->sweep->key, draw = 3 * ((layer * work->surface->nx + i) * work->surface->ny + j);
    const bool shifts = work->surface->problem->layers > 1 && random_unit(key, draw) < 0.5;
    Change change[CHANGES_MAX];
    if (!(shifts ? draw_shift : draw_flip)(work, layer, i, j, draw + 1, change))
        return;
    Best best = {.cost = INFINITY};
    const double drawn = random_unit(key, draw + 2);
    if (is_declined(work, change, shifts ? 2 : 1, drawn))
        return;
    consider(work, change, shifts ? 2 : 1, &best);
    if (best.cost >= 0.0 && drawn >= exp(-best.cost / work->sweep->temperature))
        return;
    make(work, &best);
    work->tally->flips += !shifts;
    work->tally->shifts += shifts;
}

static bool is_out_of_time(Work *work) {
    if (work->window->work < work->next_look)
        return false;
    work->next_look = work->window->work + WORK_BETWEEN_LOOKS;
    work->tally->out_of_time = stopwatch_seconds() >= work->sweep->deadline;
    return work->tally->out_of_time;
}

/* Whether the move may help on the cell; puts the cell to sleep for it. */
static bool is_open(const Work *work, uint8_t *own) {
    const int32_t move = work->sweep->move;
    const bool changed = work->tally->flips + work->tally->swaps + work->tally->shifts > 0;
    const bool found = (*own & move) && (changed || !(*own & (move << TRIED)));
    *own &= (uint8_t)~move;
    return found;
}

void tile_sweep(PlanSurface *surface, uint8_t *awake, const Tile *tile, const Sweep *sweep, const Sums *before,
                Window *window, ChangeBound *bound, Tally *tally) {
    Work work = {surface, awake, sweep, before, window, bound, tally, window->work};
    bound_begin(bound, surface, tile);
    for (size_t i = tile->top; i < tile->bottom; i++) {
        for (size_t j = tile->left; j < tile->right; j++) {
            uint8_t *own = &awake[surface_cell(surface, i, j)];
            if (sweep->move != MOVE_ANNEAL && !is_open(&work, own))
                continue;
            if (is_out_of_time(&work))
                return;
            /* reset if the move helps: then all moves of the cell are awake */
            *own |= (uint8_t)(sweep->move << TRIED);
            for (size_t layer = surface->problem->layers; layer-- > 0;) { /* the last layer is cheapest to try */
                switch (sweep->move) {
                case MOVE_FLIPS:
                    flip(&work, layer, i, j);
                    break;
                case MOVE_SWAPS:
                    swap(&work, layer, i, j);
                    break;
                case MOVE_SHIFTS:
                    shift(&work, layer, i, j);
                    break;
                default:
                    anneal(&work, layer, i, j);
                }
            }
        }
    }
}
