#include "relaxed_flow.h"

#include "drop_levels.h"
#include "droplet_flow.h"
#include "instruction_sets.h"
#include "pass_colour.h"
#include "stopwatch.h"

enum { BAND = 128, LINE = BAND + 2, ROWS_BETWEEN_LOOKS = BAND_CELLS / BAND };
enum { PLACES = CORNER + 1 };

/* The droplets of a row of the grid, 0 where no droplet falls; cell k of the band is at 1 + k. */
typedef struct {
    double amount[LINE], h1[LINE], spread[PLACES][LINE], steepness[PLACES][LINE];
    bool is_mixed; /* kinds differ within the row */
} Line;

/* Some columns of a grid, three rows at a time: row i, counted with the frame, is line i % 3. */
typedef struct {
    size_t first, count; /* columns */
    Line line[3];
} Band;

/* Three adjacent rows: droplets, and values of a framed map; cell k at 1 + k. */
typedef struct {
    const Line *above, *here, *below;
} Lines;

typedef struct {
    const double *above, *here, *below;
} Values;

static INLINED void set_first_kind(const Footprint *kind, Line *line) {
    for (size_t k = 0; k < LINE; k++)
        line->h1[k] = kind->h1;
    for (int place = SIDE; place < PLACES; place++)
        for (size_t k = 0; k < LINE; k++) {
            line->spread[place][k] = kind->spread[place];
            line->steepness[place][k] = kind->steepness[place];
        }
    line->is_mixed = false;
}

/* Sets the kind of the cells that allow it first; other cells are unchanged. */
static INLINED void set_kind(const Footprint *kind, const bool *restrict is_own, Line *line) {
    for (size_t k = 0; k < LINE; k++)
        line->h1[k] = is_own[k] ? kind->h1 : line->h1[k];
    for (int place = SIDE; place < PLACES; place++)
        for (size_t k = 0; k < LINE; k++) {
            line->spread[place][k] = is_own[k] ? kind->spread[place] : line->spread[place][k];
            line->steepness[place][k] = is_own[k] ? kind->steepness[place] : line->steepness[place][k];
        }
    line->is_mixed = true;
}

/* Loads row `row`, counted with the frame. */
static INLINED void load_line(const RelaxedStep *step, size_t row, Band *band) {
    const HorizonProblem *problem = step->problem;
    Line *line = &band->line[row % 3];
    for (size_t k = 0; k < LINE; k++)
        line->amount[k] = 0.0;
    if (line->is_mixed)
        set_first_kind(&step->kind[0], line);
    if (row == 0 || row > problem->nx)
        return;
    const size_t from = band->first > 0 ? 0 : 1;
    const size_t end = band->count + (band->first + band->count < problem->ny ? 2 : 1);
    const size_t place = (row - 1) * problem->ny + band->first + from - 1;
    const uint8_t *first = step->first + place;
    const double *droplets = step->droplets + place;
    for (size_t k = 0; k < end - from; k++)
        line->amount[from + k] = first[k] == NO_KIND ? 0.0 : droplets[k];
    for (size_t k = from; step->colour != COLOUR_ALL && k < end; k++)
        line->amount[k] = cell_colour(row - 1, band->first + k - 1) == step->colour ? line->amount[k] : 0.0;
    for (size_t kind = 1; kind < problem->kinds; kind++) {
        bool is_own[LINE] = {false}, is_any = false;
        for (size_t k = 0; k < end - from; k++) {
            is_own[from + k] = first[k] == kind;
            is_any |= first[k] == kind;
        }
        if (is_any)
            set_kind(&step->kind[kind], is_own, line);
    }
}

/* Begins a band with the columns from `first` on, before row `row` of the grid. */
static INLINED void begin_band(const RelaxedStep *step, size_t first, size_t row, Band *band) {
    const size_t left = step->problem->ny - first;
    band->first = first;
    band->count = left < BAND ? left : BAND;
    for (size_t k = 0; k < 3; k++)
        set_first_kind(&step->kind[0], &band->line[k]);
    load_line(step, row, band);
    load_line(step, row + 1, band);
}

/* The droplets about row `row` of the grid; rows are read in order. */
static INLINED Lines next_lines(const RelaxedStep *step, size_t row, Band *band) {
    load_line(step, row + 2, band);
    return (Lines){&band->line[row % 3], &band->line[(row + 1) % 3], &band->line[(row + 2) % 3]};
}

/* Values of a framed map about row `row` of the grid. */
static INLINED Values values_about(const RelaxedStep *step, const double *map, size_t row, const Band *band) {
    const size_t stride = step->problem->ny + 2;
    const double *above = map + row * stride + band->first;
    prefetch(above + 3 * stride, band->count * sizeof(double));
    return (Values){above, above + stride, above + 2 * stride};
}

static INLINED double saturated(double rise, double steepness) {
    const double share = 1.0 + (rise < 0.0 ? rise : 0.0) * steepness;
    return share > 0.0 ? share : 0.0;
}

/* Share of a unit droplet that a neighbour takes, `rise` below the droplet's cell. */
static INLINED double taken(const Line *line, size_t k, int place, double rise) {
    return line->spread[place][k] * saturated(rise, line->steepness[place][k]);
}

static INLINED double given(const Line *line, size_t k, int place, double rise) {
    return line->amount[k] * taken(line, k, place, rise);
}

/* Share of a unit droplet that its own cell keeps of a neighbour's part. */
static INLINED double kept(const Line *line, size_t k, int place, double rise) {
    return line->spread[place][k] - taken(line, k, place, rise);
}

/* Surface after the droplets of a row, added in the order of the droplets. */
static INLINED void jet_row(const Lines *lines, const Values *before, size_t count, double *restrict after) {
    const Line *above = lines->above, *here = lines->here, *below = lines->below;
    const double *up = before->above, *own = before->here, *down = before->below;
    for (size_t k = 1; k <= count; k++) {
        const double height = own[k];
        double reached = height, all = 0.0;
        reached += given(above, k - 1, CORNER, up[k - 1] - height);
        reached += given(above, k, SIDE, up[k] - height);
        reached += given(above, k + 1, CORNER, up[k + 1] - height);
        reached += given(here, k - 1, SIDE, own[k - 1] - height);
        all += kept(here, k, CORNER, height - up[k - 1]);
        all += kept(here, k, SIDE, height - up[k]);
        all += kept(here, k, CORNER, height - up[k + 1]);
        all += kept(here, k, SIDE, height - own[k - 1]);
        all += kept(here, k, SIDE, height - own[k + 1]);
        all += kept(here, k, CORNER, height - down[k - 1]);
        all += kept(here, k, SIDE, height - down[k]);
        all += kept(here, k, CORNER, height - down[k + 1]);
        reached += here->amount[k] * (here->h1[k] + all);
        reached += given(here, k + 1, SIDE, own[k + 1] - height);
        reached += given(below, k - 1, CORNER, down[k - 1] - height);
        reached += given(below, k, SIDE, down[k] - height);
        reached += given(below, k + 1, CORNER, down[k + 1] - height);
        after[k - 1] = reached;
    }
}

/* Contribution of a neighbour to the sensitivity with respect to the droplet; `own`: sensitivity to the height of the
 * droplet's cell, `ahead`: that of the neighbour less `own`. */
static INLINED double gained(const Line *line, size_t k, int place, double rise, double ahead, double own) {
    return line->spread[place][k] * own + saturated(rise, line->steepness[place][k]) * (line->spread[place][k] * ahead);
}

/* Sensitivities to the amounts of the droplets of a row. */
static INLINED void trace_amounts(const Line *here, const Values *before, const Values *later, size_t count,
                                  double *restrict gain) {
    const double *up = before->above, *at = before->here, *down = before->below;
    const double *later_up = later->above, *later_at = later->here, *later_down = later->below;
    for (size_t k = 1; k <= count; k++) {
        const double height = at[k], own = later_at[k];
        double all = here->h1[k] * own;
        all += gained(here, k, CORNER, height - up[k - 1], later_up[k - 1] - own, own);
        all += gained(here, k, SIDE, height - up[k], later_up[k] - own, own);
        all += gained(here, k, CORNER, height - up[k + 1], later_up[k + 1] - own, own);
        all += gained(here, k, SIDE, height - at[k - 1], later_at[k - 1] - own, own);
        all += gained(here, k, SIDE, height - at[k + 1], later_at[k + 1] - own, own);
        all += gained(here, k, CORNER, height - down[k - 1], later_down[k - 1] - own, own);
        all += gained(here, k, SIDE, height - down[k], later_down[k] - own, own);
        all += gained(here, k, CORNER, height - down[k + 1], later_down[k + 1] - own, own);
        gain[k - 1] = all;
    }
}

/* Contribution of a neighbour `rise` lower to the sensitivity to the height of the droplet's cell, through the flow to
 * it. */
static INLINED double passed(const Line *line, size_t k, int place, double rise, double ahead) {
    const double steepness = line->steepness[place][k];
    const double felt = 1.0 + rise * steepness > 0.0 ? steepness : 0.0, bend = rise < 0.0 ? felt : 0.0;
    return line->amount[k] * bend * (line->spread[place][k] * ahead);
}

/* Sensitivities to the heights of a row, in the order of the droplets. */
static INLINED void trace_heights(const Lines *lines, const Values *before, const Values *later, size_t count,
                                  double *restrict earlier) {
    const Line *above = lines->above, *here = lines->here, *below = lines->below;
    const double *up = before->above, *at = before->here, *down = before->below;
    const double *later_up = later->above, *later_at = later->here, *later_down = later->below;
    for (size_t k = 1; k <= count; k++) {
        const double height = at[k], own = later_at[k];
        double back = own;
        back -= passed(above, k - 1, CORNER, up[k - 1] - height, own - later_up[k - 1]);
        back -= passed(above, k, SIDE, up[k] - height, own - later_up[k]);
        back -= passed(above, k + 1, CORNER, up[k + 1] - height, own - later_up[k + 1]);
        back -= passed(here, k - 1, SIDE, at[k - 1] - height, own - later_at[k - 1]);
        back += passed(here, k, CORNER, height - up[k - 1], later_up[k - 1] - own);
        back += passed(here, k, SIDE, height - up[k], later_up[k] - own);
        back += passed(here, k, CORNER, height - up[k + 1], later_up[k + 1] - own);
        back += passed(here, k, SIDE, height - at[k - 1], later_at[k - 1] - own);
        back += passed(here, k, SIDE, height - at[k + 1], later_at[k + 1] - own);
        back += passed(here, k, CORNER, height - down[k - 1], later_down[k - 1] - own);
        back += passed(here, k, SIDE, height - down[k], later_down[k] - own);
        back += passed(here, k, CORNER, height - down[k + 1], later_down[k + 1] - own);
        back -= passed(here, k + 1, SIDE, at[k + 1] - height, own - later_at[k + 1]);
        back -= passed(below, k - 1, CORNER, down[k - 1] - height, own - later_down[k - 1]);
        back -= passed(below, k, SIDE, down[k] - height, own - later_down[k]);
        back -= passed(below, k + 1, CORNER, down[k + 1] - height, own - later_down[k + 1]);
        earlier[k - 1] = back;
    }
}

static INLINED bool jet(const RelaxedStep *step, size_t top, size_t bottom, double *after) {
    const size_t ny = step->problem->ny;
    Band band;
    for (size_t first = 0; first < ny; first += BAND) {
        begin_band(step, first, top, &band);
        for (size_t i = top; i < bottom; i++) {
            if ((i - top) % ROWS_BETWEEN_LOOKS == 0 && is_past(step->ends_at))
                return false;
            const Lines lines = next_lines(step, i, &band);
            const Values before = values_about(step, step->before, i, &band);
            jet_row(&lines, &before, band.count, after + (i + 1) * (ny + 2) + first + 1);
        }
    }
    return true;
}

/* Stores the sensitivities of the cells that are jetted, 0 where no droplet is allowed. */
static INLINED void take_gains(const RelaxedStep *step, size_t i, const Band *band, const double *gain,
                               double *gradient) {
    const size_t place = i * step->problem->ny + band->first;
    for (size_t k = 0; k < band->count; k++)
        if (step->colour == COLOUR_ALL || cell_colour(i, band->first + k) == step->colour)
            gradient[place + k] = step->first[place + k] == NO_KIND ? 0.0 : gain[k];
}

static INLINED bool trace(const RelaxedStep *step, size_t top, size_t bottom, const double *later, double *earlier,
                          double *gradient) {
    const size_t ny = step->problem->ny;
    Band band;
    double gain[BAND];
    for (size_t first = 0; first < ny; first += BAND) {
        begin_band(step, first, top, &band);
        for (size_t i = top; i < bottom; i++) {
            if ((i - top) % ROWS_BETWEEN_LOOKS == 0 && is_past(step->ends_at))
                return false;
            const Lines lines = next_lines(step, i, &band);
            const Values before = values_about(step, step->before, i, &band);
            const Values after = values_about(step, later, i, &band);
            trace_heights(&lines, &before, &after, band.count, earlier + (i + 1) * (ny + 2) + first + 1);
            trace_amounts(lines.here, &before, &after, band.count, gain);
            take_gains(step, i, &band, gain, gradient);
        }
    }
    return true;
}

static bool jet_plain(const RelaxedStep *step, size_t top, size_t bottom, double *after) {
    return jet(step, top, bottom, after);
}

static WITH_AVX2 bool jet_avx2(const RelaxedStep *step, size_t top, size_t bottom, double *after) {
    return jet(step, top, bottom, after);
}

bool jet_rows(const RelaxedStep *step, size_t top, size_t bottom, double *after) {
    return (HAS_AVX2 ? jet_avx2 : jet_plain)(step, top, bottom, after);
}

static bool trace_plain(const RelaxedStep *step, size_t top, size_t bottom, const double *later, double *earlier,
                        double *gradient) {
    return trace(step, top, bottom, later, earlier, gradient);
}

static WITH_AVX2 bool trace_avx2(const RelaxedStep *step, size_t top, size_t bottom, const double *later,
                                 double *earlier, double *gradient) {
    return trace(step, top, bottom, later, earlier, gradient);
}

bool trace_rows(const RelaxedStep *step, size_t top, size_t bottom, const double *later, double *earlier,
                double *gradient) {
    return (HAS_AVX2 ? trace_avx2 : trace_plain)(step, top, bottom, later, earlier, gradient);
}
