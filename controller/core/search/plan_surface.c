#include "plan_surface.h"

#include <string.h>

#include "map_memory.h"
#include "row_ranges.h"
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

/* The work of all threads on a surface: a step that is printed, a plan that is copied, sums of the chunks. */
typedef struct {
    PlanSurface *surface;
    size_t step;
    double ends_at;
    const int32_t *given;
    int32_t *taken;
    double sum[CHUNKS];
    Sums sums[CHUNKS];
    bool has_failed[CHUNKS]; /* of a thread: its time has ended, or its plan differs */
} Work;

/* Calls `rows` for all rows; false if it has failed in one of the threads. */
static bool run(Work *work, RowWork *rows) {
    bool has_failed = false;
    run_rows(work->surface->threads, work->surface->nx, work->surface->ny, rows, work);
    for (size_t k = 0; k < CHUNKS; k++)
        has_failed = has_failed || work->has_failed[k];
    return !has_failed;
}

static double sum_of_chunks(const Work *work) {
    double sum = 0.0;
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        sum += work->sum[chunk];
    return sum;
}

/* The cells of a chunk in a map, the frame at both ends of its rows included. */
static size_t chunk_cell(const PlanSurface *surface, size_t chunk) {
    return (1 + chunk_row(surface->nx, chunk)) * surface->stride;
}

static void copy_rows(void *context, const RowRange *range) {
    const PlanSurface *surface = ((Work *)context)->surface;
    const HorizonProblem *problem = surface->problem;
    for (size_t i = range->top; i < range->bottom; i++) {
        const size_t given = i * surface->ny, cell = surface_cell(surface, i, 0);
        memcpy(surface->target + cell, problem->target + given, surface->ny * sizeof(double));
        if (problem->weight)
            memcpy(surface->weight + cell, problem->weight + given, surface->ny * sizeof(double));
        if (surface->ceiling)
            memcpy(surface->ceiling + cell, problem->ceiling + given, surface->ny * sizeof(double));
        for (size_t j = 0; j < surface->ny; j++) {
            surface->height[cell + j] = height_on_lattice(problem->height[given + j]);
            surface->inside[cell + j] = problem->part[given + j] ? 1.0 : 0.0;
        }
    }
}

static void count_rows(void *context, const RowRange *range) {
    Work *work = context;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t first = chunk_cell(work->surface, chunk);
        work->sum[chunk] = lane_sum(work->surface->inside + first, chunk_cell(work->surface, chunk + 1) - first);
    }
}

/* Copies the problem's data into the maps. Returns the number of cells of the part. */
static double copy_maps(PlanSurface *surface) {
    Work work = {.surface = surface};
    run(&work, copy_rows); /* first: the threads share the first use of the memory */
    run(&work, count_rows);
    set_frame(surface, surface->height);
    return sum_of_chunks(&work);
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

static uint8_t *plan_row(const PlanSurface *surface, size_t layer, size_t i) {
    return surface_layer(surface, layer) + surface_cell(surface, i, 0);
}

static void compare_rows(void *context, const RowRange *range) {
    Work *work = context;
    const PlanSurface *surface = work->surface;
    for (size_t layer = 0; layer < surface->problem->layers; layer++)
        for (size_t i = range->top; i < range->bottom && !work->has_failed[range->thread]; i++) {
            const uint8_t *row = plan_row(surface, layer, i);
            const int32_t *given = work->given + (layer * surface->nx + i) * surface->ny;
            unsigned others = 0;
            for (size_t j = 0; j < surface->ny; j++)
                others += row[j] != given[j];
            work->has_failed[range->thread] = others > 0;
        }
}

bool surface_holds(PlanSurface *surface, const int32_t *plan) {
    return surface->is_evaluated && run(&(Work){.surface = surface, .given = plan}, compare_rows);
}

static void set_rows(void *context, const RowRange *range) {
    const Work *work = context;
    for (size_t layer = 0; layer < work->surface->problem->layers; layer++)
        for (size_t i = range->top; i < range->bottom; i++) {
            uint8_t *row = plan_row(work->surface, layer, i);
            const int32_t *given = work->given + (layer * work->surface->nx + i) * work->surface->ny;
            for (size_t j = 0; j < work->surface->ny; j++)
                row[j] = (uint8_t)given[j];
        }
}

void surface_set_plan(PlanSurface *surface, const int32_t *plan) {
    surface->is_evaluated = false;
    run(&(Work){.surface = surface, .given = plan}, set_rows);
}

static void take_rows(void *context, const RowRange *range) {
    const Work *work = context;
    for (size_t layer = 0; layer < work->surface->problem->layers; layer++)
        for (size_t i = range->top; i < range->bottom; i++) {
            const uint8_t *row = plan_row(work->surface, layer, i);
            int32_t *taken = work->taken + (layer * work->surface->nx + i) * work->surface->ny;
            for (size_t j = 0; j < work->surface->ny; j++)
                taken[j] = row[j];
        }
}

void surface_plan(PlanSurface *surface, int32_t *plan) {
    run(&(Work){.surface = surface, .taken = plan}, take_rows);
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

/* Prints a step on some columns; `kept`: height that each droplet leaves on its own cell. False if the time has
 * ended. */
static INLINED bool print_band(const Work *work, const RowRange *range, size_t left, size_t count) {
    const PlanSurface *surface = work->surface;
    const size_t step = work->step, top = 1 + range->top, stride = surface->stride;
    const double *before = surface_height(surface, step);
    double *after = surface_height(surface, step + 1), kept[BAND];
    const bool is_uncertain = step + 1 == surface->steps && surface->chance > 0.0; /* else the map stays 0 */
    DropletRow rows[3];
    for (size_t k = 0; k < 3; k++)
        rows[k].is_jetted = true; /* no row has been loaded yet */
    load_row(surface, step, top - 1, left, count, &rows[(top - 1) % 3]);
    load_row(surface, step, top, left, count, &rows[top % 3]);
    for (size_t row = top; row <= range->bottom; row++) {
        const DropletRow *above = &rows[(row - 1) % 3], *here = &rows[row % 3];
        DropletRow *below = &rows[(row + 1) % 3];
        const size_t cell = row * stride + left;
        const double *own = before + cell, *over = own - stride, *under = own + stride;
        if (row % BAND_ROWS == 1 && is_past(work->ends_at))
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

static INLINED void print_range(Work *work, const RowRange *range) {
    const size_t ny = work->surface->ny;
    bool is_done = true;
    for (size_t first = 0; first < ny && is_done; first += BAND)
        is_done = print_band(work, range, first + 1, ny - first < BAND ? ny - first : BAND);
    work->has_failed[range->thread] = !is_done;
}

CLONED_ROW_WORK(print_rows, print_range)

/* Computes the costs of the heights after the last step, cell by cell; 0 on the frame. */
static void take_costs(void *context, const RowRange *range) {
    const PlanSurface *surface = ((Work *)context)->surface;
    const double *last = surface_height(surface, surface->steps);
    for (size_t cell = chunk_cell(surface, range->chunk); cell < chunk_cell(surface, range->end); cell++)
        surface->cost[cell] = surface_cost(surface, cell, last[cell], surface->left_to_chance[cell]);
}

static void add_up_heights(void *context, const RowRange *range) {
    Work *work = context;
    const double *inside = work->surface->inside, *last = surface_height(work->surface, work->surface->steps);
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t first = chunk_cell(work->surface, chunk);
        work->sum[chunk] = lane_dot(inside + first, last + first, chunk_cell(work->surface, chunk + 1) - first);
    }
}

static void add_up_rows(void *context, const RowRange *range) {
    Work *work = context;
    const PlanSurface *surface = work->surface;
    const double *last = surface_height(surface, surface->steps);
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        Sums sums = {0.0, 0.0, 0.0};
        for (size_t cell = chunk_cell(surface, chunk); cell < chunk_cell(surface, chunk + 1); cell++) {
            const double inside = surface->inside[cell], height = inside * (last[cell] - surface->reference);
            const double chance = surface->left_to_chance[cell];
            const Sums own = {surface->cost[cell], height, height * height + inside * chance * chance / 3.0};
            sums = sums_after(&sums, &own);
        }
        work->sums[chunk] = sums;
    }
}

/* The reference of the heights is their mean after the last step. */
void surface_add_up(PlanSurface *surface) {
    Work work = {.surface = surface};
    run(&work, add_up_heights);
    surface->reference = height_on_lattice(sum_of_chunks(&work) / surface->weighting.count);
    run(&work, add_up_rows);
    surface->sums = (Sums){0.0, 0.0, 0.0};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        surface->sums = sums_after(&surface->sums, &work.sums[chunk]);
}

bool surface_evaluate_until(PlanSurface *surface, double ends_at) {
    Work work = {.surface = surface, .ends_at = ends_at};
    surface->is_evaluated = false;
    for (; work.step < surface->steps; work.step++) {
        if (!run(&work, print_rows))
            return false;
        set_frame(surface, surface_height(surface, work.step + 1));
    }
    run(&work, take_costs);
    surface_add_up(surface);
    surface->is_evaluated = true;
    return true;
}

void surface_evaluate(PlanSurface *surface) {
    surface_evaluate_until(surface, INFINITY);
}

static void add_up_excess(void *context, const RowRange *range) {
    Work *work = context;
    const PlanSurface *surface = work->surface;
    const double *last = surface_height(surface, surface->steps);
    for (size_t chunk = range->chunk; chunk < range->end; chunk++)
        for (size_t cell = chunk_cell(surface, chunk); cell < chunk_cell(surface, chunk + 1); cell++)
            work->sum[chunk] += surface->weight[cell] * fmax(last[cell] - surface->ceiling[cell], 0.0);
}

Objective surface_objective(PlanSurface *surface) {
    Work work = {.surface = surface};
    if (surface->ceiling)
        run(&work, add_up_excess);
    const double count = surface->weighting.count, over_ceiling = surface->problem->ceiling_cost * sum_of_chunks(&work);
    return (Objective){objective(&surface->sums, &surface->weighting), (surface->sums.cost - over_ceiling) / count,
                       over_ceiling / count, deviation(&surface->sums, &surface->weighting)};
}
