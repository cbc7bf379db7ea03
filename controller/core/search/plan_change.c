#include "plan_change.h"

#include <stdlib.h>
#include <string.h>

#include "instruction_sets.h"
#include "one_step.h"

/* cells computed at once: rows are rounded up to them; the values behind their ends are not used */
enum { LANES = 4 };

typedef struct {
    const PlanSurface *surface;
    const Change *change;
    size_t count;
    Window *window;
    ptrdiff_t top, left; /* cell of the map at the window's first cell */
} Trial;

/* Whether the flow between two cells has the same slope for all droplets. */
static bool has_even_slopes(const PlanSurface *surface) {
    const Droplet *first = &surface->droplet[1];
    bool found = true;
    for (size_t value = 2; value <= surface->problem->kinds; value++)
        for (int place = SIDE; place <= CORNER; place++)
            found = found && surface->droplet[value].slope[place] == first->slope[place];
    return found;
}

bool window_open(Window *window, const PlanSurface *surface) {
    /* a 4x4 box, one more cell each way for every step and for reading, and the rounding of rows */
    const size_t side = 2 * surface->steps + 6 + LANES;
    const size_t cells = side * side;
    *window = (Window){
        .side = side, .is_even = has_even_slopes(surface), .memory = calloc(1, cells * (7 * sizeof(double) + 1))};
    if (!window->memory)
        return false;
    window->after = window->memory;
    window->before = window->after + cells;
    for (size_t place = SIDE; place <= CORNER; place++) {
        window->spread[place] = window->after + (2 + place) * cells;
        window->slope[place] = window->after + (4 + place) * cells;
    }
    window->chance = window->after + 6 * cells;
    window->value = (uint8_t *)(window->chance + cells);
    return true;
}

void window_close(Window *window) {
    free(window->memory);
    window->memory = NULL;
}

static size_t in_window(const Trial *trial, ptrdiff_t row, ptrdiff_t column) {
    return (size_t)(row - trial->top) * trial->window->side + (size_t)(column - trial->left);
}

static size_t in_map(const Trial *trial, ptrdiff_t row, ptrdiff_t column) {
    return (size_t)row * trial->surface->stride + (size_t)column;
}

static bool keeps(const Trial *trial, size_t step) {
    return step + 1 == trial->surface->steps && trial->surface->chance > 0.0;
}

static bool is_in_step(const Trial *trial, const Change *change, size_t step) {
    return surface_step(trial->surface, change->layer, change->i, change->j) == step;
}

/* The box enlarged by the 3x3 cells around every change of the step. */
static Box with_changes(const Trial *trial, Box box, size_t step) {
    for (size_t k = 0; k < trial->count; k++) {
        const Change *change = &trial->change[k];
        const ptrdiff_t row = (ptrdiff_t)change->i + 1, column = (ptrdiff_t)change->j + 1;
        const Box cell = {row, row, column, column};
        const Box around = box_widened(&cell, trial->surface->nx, trial->surface->ny);
        if (is_in_step(trial, change, step))
            box = box_joined(&box, &around);
    }
    return box;
}

static void copy_rows(const Trial *trial, const double *map, double *local, const Box *box) {
    const size_t columns = (size_t)(box->right - box->left + 1);
    for (ptrdiff_t row = box->top; row <= box->bottom; row++)
        memcpy(local + in_window(trial, row, box->left), map + in_map(trial, row, box->left), columns * sizeof(double));
}

/* Computes the first step that differs: adds and removes droplets on the present surface. */
static void begin(const Trial *trial, const Box *box, size_t step) {
    const PlanSurface *surface = trial->surface;
    const double *before = surface_height(surface, step);
    double *after = trial->window->after;
    copy_rows(trial, surface_height(surface, step + 1), after, box);
    if (keeps(trial, step))
        copy_rows(trial, surface->left_to_chance, trial->window->chance, box);
    for (size_t k = 0; k < trial->count; k++) {
        const Change *change = &trial->change[k];
        if (!is_in_step(trial, change, step))
            continue;
        const size_t cell = surface_cell(surface, change->i, change->j);
        const size_t there = in_window(trial, (ptrdiff_t)change->i + 1, (ptrdiff_t)change->j + 1);
        const unsigned value = surface_layer(surface, change->layer)[cell];
        if (value)
            surface_add_droplet(surface, before, cell, value, -1.0, after, there, trial->window->side);
        const double kept = change->value ? surface_add_droplet(surface, before, cell, change->value, 1.0, after, there,
                                                                trial->window->side)
                                          : 0.0;
        trial->window->chance[there] = surface_chance(surface, kept);
    }
}

/* Values jetted in the step on the cells of `box`. */
static void load_values(const Trial *trial, const Box *box, size_t step) {
    const PlanSurface *surface = trial->surface;
    const Window *window = trial->window;
    const size_t passes = (size_t)surface->problem->passes, layer = step / passes;
    const int32_t colour = passes == 1 ? COLOUR_ALL : surface->problem->colours[layer][step % passes];
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        const uint8_t *values = surface_layer(surface, layer) + in_map(trial, row, box->left);
        uint8_t *own = window->value + in_window(trial, row, box->left);
        const size_t columns = (size_t)(box->right - box->left + 1);
        const size_t i = (size_t)(row - 1), j = (size_t)(box->left - 1); /* without the frame, whose values are 0 */
        for (size_t k = 0; k < columns; k++)
            own[k] = colour == COLOUR_ALL || colour == cell_colour(i, j + k) ? values[k] : 0;
    }
    for (size_t k = 0; k < trial->count; k++)
        if (is_in_step(trial, &trial->change[k], step))
            window->value[in_window(trial, (ptrdiff_t)trial->change[k].i + 1, (ptrdiff_t)trial->change[k].j + 1)] =
                (uint8_t)trial->change[k].value;
}

/* Loads the largest shares, and for mixed kinds the slopes, of the droplets in the window. */
static INLINED void load_shares(const Trial *trial, const Box *box) {
    const PlanSurface *surface = trial->surface;
    const Window *window = trial->window;
    const bool is_single = surface->problem->kinds == 1;
    const double side = surface->droplet[1].spread[SIDE], corner = surface->droplet[1].spread[CORNER];
    const size_t columns = (size_t)(box->right - box->left + LANES) / LANES * LANES;
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        const size_t first = in_window(trial, row, box->left);
        const uint8_t *value = window->value + first;
        double *restrict sides = window->spread[SIDE] + first, *restrict corners = window->spread[CORNER] + first;
        for (size_t lanes = 0; is_single && lanes < columns; lanes += LANES)
            for (size_t k = lanes; k < lanes + LANES; k++) {
                sides[k] = side * value[k];
                corners[k] = corner * value[k];
            }
        for (size_t k = 0; !is_single && k < columns; k++) {
            sides[k] = surface->droplet[value[k]].spread[SIDE];
            corners[k] = surface->droplet[value[k]].spread[CORNER];
        }
        for (int place = SIDE; !window->is_even && place <= CORNER; place++)
            for (size_t k = 0; k < columns; k++)
                window->slope[place][first + k] = surface->droplet[value[k]].slope[place];
    }
}

/* Share that a cell gives to a neighbour less the share it gets from it; the neighbour lies `rise` lower. */
static INLINED double loss(double spread, double slope, double its_spread, double its_slope, double rise) {
    return flow(spread, slope, rise) - flow(its_spread, its_slope, -rise);
}

/* Subtracts from a row of cells their losses to the neighbours `one` and `other` cells before and behind. The arrays do
 * not overlap, so that the loop can be vectorised. */
static INLINED void take_losses(double *restrict after, const double *restrict before, const double *restrict spread,
                                const double *restrict slope, ptrdiff_t one, ptrdiff_t other, ptrdiff_t columns) {
    for (ptrdiff_t k = 0; k < columns; k++)
        after[k] -= loss(spread[k], slope[k], spread[k - one], slope[k - one], before[k] - before[k - one]) +
                    loss(spread[k], slope[k], spread[k + one], slope[k + one], before[k] - before[k + one]) +
                    loss(spread[k], slope[k], spread[k - other], slope[k - other], before[k] - before[k - other]) +
                    loss(spread[k], slope[k], spread[k + other], slope[k + other], before[k] - before[k + other]);
}

/* The same between cells whose droplets all have one slope: then one of the two shares is whole, or both are. */
static INLINED double even_loss(double spread, double its_spread, double slope, double rise) {
    return (spread - its_spread) + between(-spread, on_lattice(slope * rise), its_spread);
}

static INLINED void take_even_losses(double *restrict after, const double *restrict before,
                                     const double *restrict spread, double slope, ptrdiff_t one, ptrdiff_t other,
                                     ptrdiff_t columns) {
    for (ptrdiff_t k = 0; k < columns; k++)
        after[k] -= even_loss(spread[k], spread[k - one], slope, before[k] - before[k - one]) +
                    even_loss(spread[k], spread[k + one], slope, before[k] - before[k + one]) +
                    even_loss(spread[k], spread[k - other], slope, before[k] - before[k - other]) +
                    even_loss(spread[k], spread[k + other], slope, before[k] - before[k + other]);
}

/* Prints the step on the surface in `before`. */
static INLINED void print_window(const Trial *trial, const Box *box) {
    const Droplet *droplet = trial->surface->droplet;
    const Window *window = trial->window;
    const ptrdiff_t side = (ptrdiff_t)window->side, columns = (box->right - box->left + LANES) / LANES * LANES;
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        const size_t first = in_window(trial, row, box->left);
        const double *before = window->before + first;
        double *after = window->after + first;
        for (ptrdiff_t k = 0; k < columns; k++)
            after[k] = before[k] + droplet[window->value[first + (size_t)k]].volume;
        if (window->is_even) {
            take_even_losses(after, before, window->spread[SIDE] + first, droplet[1].slope[SIDE], 1, side, columns);
            take_even_losses(after, before, window->spread[CORNER] + first, droplet[1].slope[CORNER], side + 1,
                             side - 1, columns);
            continue;
        }
        take_losses(after, before, window->spread[SIDE] + first, window->slope[SIDE] + first, 1, side, columns);
        take_losses(after, before, window->spread[CORNER] + first, window->slope[CORNER] + first, side + 1, side - 1,
                    columns);
    }
}

/* Subtracts from a row of droplets the shares of the neighbours `one` and `other` cells before and behind. */
static INLINED void take_shares(double *restrict kept, const double *restrict before, const double *restrict spread,
                                const double *restrict slope, ptrdiff_t one, ptrdiff_t other, ptrdiff_t columns) {
    for (ptrdiff_t k = 0; k < columns; k++)
        kept[k] -= flow(spread[k], slope[k], before[k] - before[k - one]) +
                   flow(spread[k], slope[k], before[k] - before[k + one]) +
                   flow(spread[k], slope[k], before[k] - before[k - other]) +
                   flow(spread[k], slope[k], before[k] - before[k + other]);
}

static INLINED void take_even_shares(double *restrict kept, const double *restrict before,
                                     const double *restrict spread, double slope, ptrdiff_t one, ptrdiff_t other,
                                     ptrdiff_t columns) {
    for (ptrdiff_t k = 0; k < columns; k++)
        kept[k] -= flow(spread[k], slope, before[k] - before[k - one]) +
                   flow(spread[k], slope, before[k] - before[k + one]) +
                   flow(spread[k], slope, before[k] - before[k - other]) +
                   flow(spread[k], slope, before[k] - before[k + other]);
}

/* Computes the height that the droplets of the step leave on their own cells, and from it their uncertainty. */
static INLINED void keep_droplets(const Trial *trial, const Box *box) {
    const Window *window = trial->window;
    const Droplet *droplet = trial->surface->droplet;
    const ptrdiff_t side = (ptrdiff_t)window->side, columns = (box->right - box->left + LANES) / LANES * LANES;
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        const size_t first = in_window(trial, row, box->left);
        const double *before = window->before + first;
        double *kept = window->chance + first;
        for (ptrdiff_t k = 0; k < columns; k++)
            kept[k] = droplet[window->value[first + (size_t)k]].volume;
        if (window->is_even) {
            take_even_shares(kept, before, window->spread[SIDE] + first, droplet[1].slope[SIDE], 1, side, columns);
            take_even_shares(kept, before, window->spread[CORNER] + first, droplet[1].slope[CORNER], side + 1, side - 1,
                             columns);
        } else {
            take_shares(kept, before, window->spread[SIDE] + first, window->slope[SIDE] + first, 1, side, columns);
            take_shares(kept, before, window->spread[CORNER] + first, window->slope[CORNER] + first, side + 1, side - 1,
                        columns);
        }
        for (ptrdiff_t k = 0; k < columns; k++)
            kept[k] = surface_chance(trial->surface, kept[k]);
    }
}

/* Prints the step in the box; read: the box and the cells around it. */
static INLINED void print_box(const Trial *trial, const Box *box, const Box *read, size_t step) {
    load_shares(trial, read);
    print_window(trial, box);
    if (keeps(trial, step))
        keep_droplets(trial, box);
}

static void print_box_plain(const Trial *trial, const Box *box, const Box *read, size_t step) {
    print_box(trial, box, read, step);
}

static WITH_AVX2 void print_box_avx2(const Trial *trial, const Box *box, const Box *read, size_t step) {
    print_box(trial, box, read, step);
}

/* Continues with the next step: the surface in `after`, which differs in `box`, becomes the one before it. */
static void carry(const Trial *trial, const Box *box, const Box *next, size_t step) {
    Window *window = trial->window;
    const Box read = {next->top - 1, next->bottom + 1, next->left - 1, next->right + 1};
    const size_t columns = (size_t)(box->right - box->left + 1);
    copy_rows(trial, surface_height(trial->surface, step), window->before, &read);
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        const size_t first = in_window(trial, row, box->left);
        memcpy(window->before + first, window->after + first, columns * sizeof(double));
    }
    load_values(trial, &read, step);
    (HAS_AVX2 ? print_box_avx2 : print_box_plain)(trial, next, &read, step);
}

/* The smallest box that holds all cells whose height after the step differs. */
static Box differing(const Trial *trial, const Box *box, size_t step) {
    const double *map = surface_height(trial->surface, step + 1), *after = trial->window->after;
    Box found = {box->bottom + 1, box->top - 1, box->right + 1, box->left - 1};
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        for (ptrdiff_t column = box->left; column <= box->right; column++) {
            if (after[in_window(trial, row, column)] == map[in_map(trial, row, column)])
                continue;
            found.top = row < found.top ? row : found.top;
            found.bottom = row;
            found.left = column < found.left ? column : found.left;
            found.right = column > found.right ? column : found.right;
        }
    }
    return found;
}

static Sums change_of_sums(const Trial *trial, const Box *box) {
    const PlanSurface *surface = trial->surface;
    const double *last = surface_height(surface, surface->steps);
    Sums change = {0.0, 0.0, 0.0};
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        for (ptrdiff_t column = box->left; column <= box->right; column++) {
            const size_t cell = in_map(trial, row, column);
            const size_t there = in_window(trial, row, column);
            const double was = last[cell], is = trial->window->after[there], inside = surface->inside[cell];
            const double raised = inside * (is - was), chance_was = surface->left_to_chance[cell];
            const double chance = keeps(trial, surface->steps - 1) ? trial->window->chance[there] : 0.0;
            change.cost += surface_cost(surface, cell, is, chance) - surface->cost[cell];
            change.height += raised;
            change.squared_height += raised * ((is - surface->reference) + (was - surface->reference)) +
                                     inside * (chance * chance - chance_was * chance_was) / 3.0;
        }
    }
    return change;
}

static void write_rows(const Trial *trial, const double *local, double *map, const Box *box) {
    const size_t columns = (size_t)(box->right - box->left + 1);
    for (ptrdiff_t row = box->top; row <= box->bottom; row++)
        memcpy(map + in_map(trial, row, box->left), local + in_window(trial, row, box->left), columns * sizeof(double));
}

static void take_costs(PlanSurface *surface, const Box *box) {
    const double *last = surface_height(surface, surface->steps);
    for (ptrdiff_t row = box->top; row <= box->bottom; row++)
        for (ptrdiff_t column = box->left; column <= box->right; column++) {
            const size_t cell = (size_t)row * surface->stride + (size_t)column;
            surface->cost[cell] = surface_cost(surface, cell, last[cell], surface->left_to_chance[cell]);
        }
}

static const Box NOWHERE = {1, 0, 1, 0};

/* Propagates the changes through all steps, and stores them in the maps of `made` if that is not NULL; returns the box
 * where the last surface differs, and in `touched` the box where any does. */
static Box carry_through(const Trial *trial, PlanSurface *made, Box *touched) {
    const PlanSurface *surface = trial->surface;
    Box box = NOWHERE;
    *touched = NOWHERE;
    for (size_t step = 0; step < surface->steps; step++) {
        const bool begins = box_is_empty(&box);
        const Box wide = begins ? box : box_widened(&box, surface->nx, surface->ny);
        const Box next = with_changes(trial, wide, step);
        if (box_is_empty(&next))
            continue;
        trial->window->work += (next.bottom - next.top + 1) * (next.right - next.left + 1);
        if (begins)
            begin(trial, &next, step);
        else
            carry(trial, &box, &next, step);
        box = step + 1 < surface->steps ? differing(trial, &next, step) : next;
        *touched = box_joined(touched, &next);
        if (made)
            write_rows(trial, trial->window->after, surface_height(made, step + 1), &next);
        if (made && keeps(trial, step))
            write_rows(trial, trial->window->chance, made->left_to_chance, &next);
        if (made && step + 1 == surface->steps)
            take_costs(made, &next);
    }
    return box;
}

static Trial trial_of(const PlanSurface *surface, const Change *change, size_t count, Window *window) {
    const ptrdiff_t reach = (ptrdiff_t)surface->steps + 2;
    return (Trial){surface, change, count, window, (ptrdiff_t)change->i + 1 - reach, (ptrdiff_t)change->j + 1 - reach};
}

Sums plan_trial(const PlanSurface *surface, const Change *change, size_t count, Window *window) {
    if (surface->steps == 1) {
        window->work += FOOTPRINT;
        return one_step_trial(surface, change, count, false);
    }
    const Trial trial = trial_of(surface, change, count, window);
    Box touched;
    const Box box = carry_through(&trial, NULL, &touched);
    return change_of_sums(&trial, &box);
}

Sums plan_trial_worth(const PlanSurface *surface, const Change *change, size_t count, Window *window) {
    if (!is_cost_enough(surface))
        return plan_trial(surface, change, count, window);
    window->work += FOOTPRINT;
    return one_step_trial(surface, change, count, true);
}

Box plan_apply(PlanSurface *surface, const Change *change, size_t count, Window *window) {
    const Trial trial = trial_of(surface, change, count, window);
    Box touched = NOWHERE;
    if (surface->steps == 1)
        one_step_apply(surface, change, count);
    else
        carry_through(&trial, surface, &touched);
    for (size_t k = 0; k < count; k++)
        surface_layer(surface, change[k].layer)[surface_cell(surface, change[k].i, change[k].j)] =
            (uint8_t)change[k].value;
    return touched;
}
