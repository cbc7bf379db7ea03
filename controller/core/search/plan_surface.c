#include "plan_surface.h"

#include <string.h>

#include "instruction_sets.h"
#include "map_memory.h"
#include "parallel.h"
#include "stopwatch.h"

/* Gains below this share of a droplet's height are rounding, and chasing them would never end (assumed). */
static const double LEAST_SHARE_OF_DROPLET = 1e-9;

/* Bound of a uniform distribution whose standard deviation is 1: the square root of 3. */
static const double UNIFORM_BOUND = 1.7320508075688772;

/* Height of the frame [m]: below every cell by more than any droplet spreads. */
static const double ABYSS = -1.0;

static bool take_memory(PlanSurface *surface) {
    const HorizonProblem *problem = surface->problem;
    const size_t maps = surface->steps + 5 + (problem->weight != NULL) + (problem->ceiling != NULL),
                 length = surface->framed + MAP_MARGIN;
    const size_t bytes = problem->layers * surface->framed;
    surface->memory = take_maps(1, maps * length * sizeof(double) + bytes);
    if (!surface->memory)
        return false;
    double *next = surface->memory;
    double **single[] = {&surface->target, &surface->inside, &surface->left_to_chance, &surface->cost};
    for (size_t k = 0; k < sizeof single / sizeof *single; k++, next += length)
        *single[k] = next;
    surface->weight = surface->inside;
    if (problem->weight) {
        surface->weight = next;
        next += length;
    }
    if (problem->ceiling) {
        surface->ceiling = next;
        next += length;
    }
    surface->height = next;
    surface->plan = (uint8_t *)(next + (surface->steps + 1) * surface->framed + MAP_MARGIN);
    return true;
}

static void set_frame(const PlanSurface *surface, double *height) {
    for (size_t i = 0; i < surface->nx + 2; i++)
        height[i * surface->stride] = height[i * surface->stride + surface->ny + 1] = ABYSS;
    for (size_t j = 0; j < surface->stride; j++)
        height[j] = height[surface->framed - 1 - j] = ABYSS;
}

/* Copies the problem's data into the maps. Returns the number of cells of the part. */
static double copy_maps(PlanSurface *surface) {
    const HorizonProblem *problem = surface->problem;
    double count = 0.0;
    set_frame(surface, surface->height);
    for (size_t i = 0; i < surface->nx; i++) {
        const size_t given = i * surface->ny, cell = surface_cell(surface, i, 0);
        memcpy(surface->target + cell, problem->target + given, surface->ny * sizeof(double));
        if (problem->weight)
            memcpy(surface->weight + cell, problem->weight + given, surface->ny * sizeof(double));
        if (surface->ceiling)
            memcpy(surface->ceiling + cell, problem->ceiling + given, surface->ny * sizeof(double));
        for (size_t j = 0; j < surface->ny; j++) {
            surface->height[cell + j] = height_on_lattice(problem->height[given + j]);
            surface->inside[cell + j] = problem->part[given + j] ? 1.0 : 0.0;
            count += surface->inside[cell + j];
        }
    }
    return count;
}

bool surface_open(PlanSurface *surface, const HorizonProblem *problem, const int32_t *plan) {
    bool is_evaluated;
    return surface_open_until(surface, problem, plan, INFINITY, 1, &is_evaluated);
}

bool surface_open_until(PlanSurface *surface, const HorizonProblem *problem, const int32_t *plan, double ends_at,
                        int32_t threads, bool *is_evaluated) {
    const size_t stride = problem->ny + 2;
    *surface = (PlanSurface){.problem = problem,
                             .nx = problem->nx,
                             .ny = problem->ny,
                             .stride = stride,
                             .framed = (problem->nx + 2) * stride,
                             .steps = problem->layers * (size_t)problem->passes,
                             .threads = (size_t)threads,
                             .upward = 0.5 * (problem->overshoot + 1.0),
                             .skew = 0.5 * (problem->overshoot - 1.0)};
    if (!take_memory(surface))
        return false;
    double tallest = 0.0, smallest = problem->kind[0].h1;
    for (size_t k = 0; k < problem->kinds; k++) {
        surface->droplet[1 + k] = droplet_of(&problem->kind[k]);
        tallest = fmax(tallest, problem->kind[k].h1);
        smallest = fmin(smallest, problem->kind[k].h1);
    }
    surface->chance = UNIFORM_BOUND * problem->droplet_std;
    surface->least_chance = surface->chance * smallest;
    surface->weighting = (Weighting){problem->alpha, copy_maps(surface)};
    surface->droplet_worth = tallest / surface->weighting.count;
    surface->least_gain = LEAST_SHARE_OF_DROPLET * surface->droplet_worth;
    surface_set_plan(surface, plan);
    *is_evaluated = surface_evaluate_until(surface, ends_at);
    return true;
}

void surface_close(PlanSurface *surface) {
    give_maps(surface->memory);
    surface->memory = NULL;
}

bool surface_holds(const PlanSurface *surface, const int32_t *plan) {
    bool found = surface->is_evaluated;
    for (size_t layer = 0; layer < surface->problem->layers; layer++)
        for (size_t i = 0; found && i < surface->nx; i++) {
            const uint8_t *row = surface_layer(surface, layer) + surface_cell(surface, i, 0);
            unsigned others = 0;
            for (size_t j = 0; j < surface->ny; j++)
                others += row[j] != *plan++;
            found = others == 0;
        }
    return found;
}

void surface_set_plan(PlanSurface *surface, const int32_t *plan) {
    surface->is_evaluated = false;
    for (size_t layer = 0; layer < surface->problem->layers; layer++)
        for (size_t i = 0; i < surface->nx; i++)
            for (size_t j = 0; j < surface->ny; j++)
                surface_layer(surface, layer)[surface_cell(surface, i, j)] = (uint8_t)*plan++;
}

void surface_plan(const PlanSurface *surface, int32_t *plan) {
    for (size_t layer = 0; layer < surface->problem->layers; layer++)
        for (size_t i = 0; i < surface->nx; i++)
            for (size_t j = 0; j < surface->ny; j++)
                *plan++ = surface_layer(surface, layer)[surface_cell(surface, i, j)];
}

double surface_add_droplet(const PlanSurface *surface, const double *before, size_t cell, unsigned value, double sign,
                           double *after, size_t there, size_t stride) {
    const Droplet *droplet = &surface->droplet[value];
    const double here = before[cell];
    double kept = droplet->volume;
    for (int di = -1; di <= 1; di++) {
        const double *row = before + cell + di * (ptrdiff_t)surface->stride;
        double *row_after = after + there + di * (ptrdiff_t)stride;
        for (int dj = -1; dj <= 1; dj++) {
            if (di == 0 && dj == 0)
                continue;
            const int place = di == 0 || dj == 0 ? SIDE : CORNER;
            const double taken = flow(droplet->spread[place], droplet->slope[place], here - row[dj]);
            row_after[dj] += sign * taken;
            kept -= taken;
        }
    }
    after[there] += sign * kept;
    return kept;
}

enum {
    BAND = 128,
    FRAMED_BAND = BAND + 2,
    BAND_ROWS = BAND_CELLS / BAND
}; /* columns printed together; cell k of a band is at 1 + k */

/* Droplets of a row of a band, jetted in one step. */
typedef struct {
    bool is_jetted; /* some cell has a droplet; if none has, all values are 0 */
    double volume[FRAMED_BAND], spread[2][FRAMED_BAND], slope[2][FRAMED_BAND];
} DropletRow;

/* Loads row `row` of the map, columns from `left` - 1 to `left` + count, without the droplets of other steps. */
static INLINED void load_row(const PlanSurface *surface, size_t step, size_t row, size_t left, size_t count,
                             DropletRow *droplets) {
    const size_t passes = (size_t)surface->problem->passes, layer = step / passes;
    const uint8_t *values = surface_layer(surface, layer) + row * surface->stride + left - 1;
    const Droplet *droplet = surface->droplet;
    uint8_t any = 0;
    for (size_t k = 0; k < count + 2; k++)
        any |= values[k];
    if (!any && droplets->is_jetted)
        memset(droplets, 0, sizeof *droplets);
    droplets->is_jetted = any != 0;
    if (!any)
        return;
    for (size_t k = 0; k < count + 2; k++) {
        const bool falls = values[k] && (passes == 1 || surface_step(surface, layer, row - 1, left + k - 2) == step);
        const Droplet *own = &droplet[falls ? values[k] : 0];
        droplets->volume[k] = own->volume;
        for (int place = SIDE; place <= CORNER; place++) {
            droplets->spread[place][k] = own->spread[place];
            droplets->slope[place][k] = own->slope[place];
        }
    }
}

/* Subtracts from the cells of a row the flow to the neighbours `ahead` columns further in another row, and adds the
 * flow from there. */
static INLINED void exchange(const DropletRow *here, const DropletRow *there, int place, size_t ahead, size_t count,
                             const double *restrict before, const double *restrict its, double *restrict left,
                             double *restrict after) {
    const double *spread = here->spread[place] + 1, *slope = here->slope[place] + 1;
    const double *its_spread = there->spread[place] + ahead, *its_slope = there->slope[place] + ahead;
    for (size_t k = 0; k < count; k++) {
        const double rise = before[k] - its[k], lost = flow(spread[k], slope[k], rise);
        left[k] -= lost;
        after[k] += flow(its_spread[k], its_slope[k], -rise) - lost;
    }
}

/* Rows `top` to `bottom` excluded of a step, for one thread; all rows are 1 to nx. */
typedef struct {
    PlanSurface *surface;
    size_t step, top, bottom;
    double ends_at;
    bool is_done;
} RowShare;

/* Calls `work` for all rows; false if one of the threads has run out of time. */
static bool run_rows(void *(*work)(void *share), PlanSurface *surface, size_t step, double ends_at) {
    size_t threads = useful_threads(surface->threads, surface->framed);
    RowShare shares[MAX_PARALLEL];
    bool is_done = true;
    threads = threads < surface->nx ? threads : surface->nx;
    for (size_t k = 0; k < threads; k++)
        shares[k] = (RowShare){.surface = surface,
                               .step = step,
                               .top = 1 + surface->nx * k / threads,
                               .bottom = 1 + surface->nx * (k + 1) / threads,
                               .ends_at = ends_at};
    run_parallel(work, shares, sizeof *shares, threads);
    for (size_t k = 0; k < threads; k++)
        is_done = is_done && shares[k].is_done;
    return is_done;
}

/* Prints a step on some columns; `kept`: height that each droplet leaves on its own cell. False if the time has
 * ended. */
static INLINED bool print_band(const RowShare *share, size_t left, size_t count) {
    const PlanSurface *surface = share->surface;
    const size_t step = share->step;
    const size_t stride = surface->stride;
    const double *before = surface_height(surface, step);
    double *after = surface_height(surface, step + 1), kept[BAND];
    const bool is_uncertain = step + 1 == surface->steps && surface->chance > 0.0; /* else the map stays 0 */
    DropletRow rows[3];
    for (size_t k = 0; k < 3; k++)
        rows[k].is_jetted = true; /* no row has been loaded yet */
    load_row(surface, step, share->top - 1, left, count, &rows[(share->top - 1) % 3]);
    load_row(surface, step, share->top, left, count, &rows[share->top % 3]);
    for (size_t row = share->top; row < share->bottom; row++) {
        const DropletRow *above = &rows[(row - 1) % 3], *here = &rows[row % 3];
        DropletRow *below = &rows[(row + 1) % 3];
        const size_t cell = row * stride + left;
        const double *own = before + cell, *over = own - stride, *under = own + stride;
        if (row % BAND_ROWS == 1 && is_past(share->ends_at))
            return false;
        load_row(surface, step, row + 1, left, count, below);
        if (!above->is_jetted && !here->is_jetted && !below->is_jetted) {
            memcpy(after + cell, own, count * sizeof *own);
            for (size_t k = 0; is_uncertain && k < count; k++)
                surface->left_to_chance[cell + k] = surface_chance(surface, 0.0);
            continue;
        }
        for (size_t k = 0; k < count; k++) {
            kept[k] = here->volume[1 + k];
            after[cell + k] = own[k] + here->volume[1 + k];
        }
        exchange(here, above, CORNER, 0, count, own, over - 1, kept, after + cell);
        exchange(here, above, SIDE, 1, count, own, over, kept, after + cell);
        exchange(here, above, CORNER, 2, count, own, over + 1, kept, after + cell);
        exchange(here, here, SIDE, 0, count, own, own - 1, kept, after + cell);
        exchange(here, here, SIDE, 2, count, own, own + 1, kept, after + cell);
        exchange(here, below, CORNER, 0, count, own, under - 1, kept, after + cell);
        exchange(here, below, SIDE, 1, count, own, under, kept, after + cell);
        exchange(here, below, CORNER, 2, count, own, under + 1, kept, after + cell);
        for (size_t k = 0; is_uncertain && k < count; k++)
            surface->left_to_chance[cell + k] = surface_chance(surface, kept[k]);
    }
    return true;
}

static INLINED void print_rows(RowShare *share) {
    const size_t ny = share->surface->ny;
    share->is_done = true;
    for (size_t first = 0; first < ny && share->is_done; first += BAND)
        share->is_done = print_band(share, first + 1, ny - first < BAND ? ny - first : BAND);
}

static void print_plain(RowShare *share) {
    print_rows(share);
}

static WITH_AVX2 void print_avx2(RowShare *share) {
    print_rows(share);
}

static void *print_share(void *handed) {
    (HAS_AVX2 ? print_avx2 : print_plain)(handed);
    return NULL;
}

/* Computes the costs of the heights after the last step, cell by cell; 0 on the frame. */
static void *take_costs(void *handed) {
    RowShare *share = handed;
    const PlanSurface *surface = share->surface;
    const double *last = surface_height(surface, surface->steps);
    for (size_t cell = share->top * surface->stride; cell < share->bottom * surface->stride; cell++)
        surface->cost[cell] = surface_cost(surface, cell, last[cell], surface->left_to_chance[cell]);
    share->is_done = true;
    return NULL;
}

/* The reference of the heights is their mean after the last step. */
void surface_add_up(PlanSurface *surface) {
    const double *last = surface_height(surface, surface->steps);
    double mean = 0.0;
    for (size_t cell = 0; cell < surface->framed; cell++)
        mean += surface->inside[cell] * last[cell];
    surface->reference = height_on_lattice(mean / surface->weighting.count);
    surface->sums = (Sums){0.0, 0.0, 0.0};
    for (size_t cell = 0; cell < surface->framed; cell++) {
        const double inside = surface->inside[cell], height = inside * (last[cell] - surface->reference);
        const double chance = surface->left_to_chance[cell];
        const Sums own = {surface->cost[cell], height, height * height + inside * chance * chance / 3.0};
        surface->sums = sums_after(&surface->sums, &own);
    }
}

bool surface_evaluate_until(PlanSurface *surface, double ends_at) {
    surface->is_evaluated = false;
    for (size_t step = 0; step < surface->steps; step++) {
        if (!run_rows(print_share, surface, step, ends_at))
            return false;
        set_frame(surface, surface_height(surface, step + 1));
    }
    run_rows(take_costs, surface, surface->steps, ends_at);
    surface_add_up(surface);
    surface->is_evaluated = true;
    return true;
}

void surface_evaluate(PlanSurface *surface) {
    surface_evaluate_until(surface, INFINITY);
}

Objective surface_objective(const PlanSurface *surface) {
    const double *last = surface_height(surface, surface->steps);
    double over_ceiling = 0.0;
    for (size_t cell = 0; surface->ceiling && cell < surface->framed; cell++)
        over_ceiling += surface->weight[cell] * fmax(last[cell] - surface->ceiling[cell], 0.0);
    over_ceiling *= surface->problem->ceiling_cost;
    const double count = surface->weighting.count;
    return (Objective){objective(&surface->sums, &surface->weighting), (surface->sums.cost - over_ceiling) / count,
                       over_ceiling / count, deviation(&surface->sums, &surface->weighting)};
}
