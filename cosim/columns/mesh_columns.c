#include "mesh_columns.h"

#include <stdbool.h>
#include <stdlib.h>

#include "column_hits.h"

enum { BAND_CELLS = 1 << 14 }; /* cells whose hits are collected and sorted together, at least a row: fits a cache */
static const uint32_t NONE = UINT32_MAX;

/* Point where an edge crosses a row. */
typedef struct {
    double y, z;
} Crossing;

/* Rows of the grid that are done together, and the triangles that each of these bands is next to meet. */
typedef struct {
    size_t rows, count; /* rows of a band, bands */
    uint32_t *head;     /* the first triangle of each band, NONE if it has none */
    uint32_t *next;     /* the one after each triangle */
} Bands;

/* Memory for the hits of one band. */
typedef struct {
    HitList hits, sorted;
    size_t *begin; /* of each cell's hits in `sorted`, one more than cells */
} Workspace;

static double smaller(double a, double b) {
    return a < b ? a : b;
}

static double larger(double a, double b) {
    return a > b ? a : b;
}

/* The first whole number that is not below `value`, at least 0 and at most `end`; 0 for nan. */
static size_t ceiling(double value, size_t end) {
    if (!(value > 0.0))
        return 0;
    if (value >= (double)end)
        return end;
    const size_t whole = (size_t)value;
    return whole + ((double)whole < value);
}

static size_t first_row(const Triangle *triangle, size_t nx) {
    const Corner *c = triangle->corner;
    return ceiling(smaller(c[0].x, smaller(c[1].x, c[2].x)), nx);
}

static size_t end_row(const Triangle *triangle, size_t nx) {
    const Corner *c = triangle->corner;
    return ceiling(larger(c[0].x, larger(c[1].x, c[2].x)), nx);
}

static Crossing crossing(const Corner *low, const Corner *high, double row) {
    const double share = (row - low->x) / (high->x - low->x);
    return (Crossing){low->y + share * (high->y - low->y), low->z + share * (high->z - low->z)};
}

/* The corners in the order of their rows; the long edge goes from the first to the last, beside the middle. */
typedef struct {
    const Corner *low, *middle, *high;
    bool long_goes_up; /* (+x) around the triangle */
} Edges;

static Edges edges_of(const Triangle *triangle) {
    const Corner *c = triangle->corner;
    int low = 0, high = 2;
    for (int n = 1; n < 3; n++)
        low = c[n].x < c[low].x ? n : low;
    for (int n = 1; n >= 0; n--)
        high = c[n].x > c[high].x ? n : high;
    if (low == high) /* all in one row, or not numbers */
        high = (low + 1) % 3;
    return (Edges){&c[low], &c[3 - low - high], &c[high], high == (low + 1) % 3};
}

/* Hits of one triangle in one row of cells, which are numbered from `first_cell`. The heights depend on the three
 * corners alone: two bodies that share a triangle, the other way round, have it at the same heights. */
static int32_t add_row(const Edges *edges, double row, size_t ny, size_t first_cell, HitList *hits) {
    const Crossing of_long = crossing(edges->low, edges->high, row);
    const Crossing of_short =
        row < edges->middle->x ? crossing(edges->low, edges->middle, row) : crossing(edges->middle, edges->high, row);
    const size_t from_long = ceiling(of_long.y, ny), from_short = ceiling(of_short.y, ny);
    if (from_long == from_short)
        return COLUMNS_DONE;
    const bool long_is_left = from_long < from_short;
    const Crossing left = long_is_left ? of_long : of_short, right = long_is_left ? of_short : of_long;
    const size_t begin = long_is_left ? from_long : from_short, end = long_is_left ? from_short : from_long;
    /* counterclockwise from above, the edge that goes up has the triangle on its +y side: a top, where lines leave */
    const int32_t step = edges->long_goes_up == long_is_left ? -1 : 1;
    const double slope = (right.z - left.z) / (right.y - left.y);
    const double low = smaller(left.z, right.z), high = larger(left.z, right.z);
    if (hit_reserve(hits, end - begin))
        return COLUMNS_NO_MEMORY;
    for (size_t j = begin; j < end; j++) {
        const double z = left.z + ((double)j - left.y) * slope; /* of a sliver: may round beyond, or be nan */
        hit_append(hits, larger(low, smaller(z, high)), first_cell + j, step);
    }
    return COLUMNS_DONE;
}

static int32_t start_bands(size_t nx, size_t ny, size_t count, const Triangle *triangles, Bands *bands) {
    bands->rows = ny < BAND_CELLS ? BAND_CELLS / ny : 1;
    bands->count = (nx + bands->rows - 1) / bands->rows;
    bands->head = malloc(bands->count * sizeof *bands->head);
    bands->next = malloc((count + 1) * sizeof *bands->next);
    if (!bands->head || !bands->next)
        return COLUMNS_NO_MEMORY;
    for (size_t band = 0; band < bands->count; band++)
        bands->head[band] = NONE;
    for (size_t n = count; n-- > 0;) {
        const size_t row = first_row(&triangles[n], nx);
        if (row < end_row(&triangles[n], nx)) {
            bands->next[n] = bands->head[row / bands->rows];
            bands->head[row / bands->rows] = (uint32_t)n;
        }
    }
    return COLUMNS_DONE;
}

/* Hits of all triangles of a band; those that reach further go to the next band. */
static int32_t hit_band(size_t nx, size_t ny, const Triangle *triangles, Bands *bands, size_t band, HitList *hits) {
    const size_t first = band * bands->rows, limit = first + bands->rows < nx ? first + bands->rows : nx;
    hits->count = 0;
    for (uint32_t n = bands->head[band], next; n != NONE; n = next) {
        const Triangle *triangle = &triangles[n];
        const size_t from = first_row(triangle, nx), to = end_row(triangle, nx);
        const Edges edges = edges_of(triangle);
        for (size_t row = from > first ? from : first; row < to && row < limit; row++)
            if (add_row(&edges, (double)row, ny, (row - first) * ny, hits))
                return COLUMNS_NO_MEMORY;
        next = bands->next[n];
        if (to > limit) {
            bands->next[n] = bands->head[band + 1];
            bands->head[band + 1] = n;
        }
    }
    return COLUMNS_DONE;
}

static void count_column(ColumnState state, size_t cell, const Hit *hits, size_t count, MeshReport *report) {
    report->occupied += 1;
    for (size_t n = 0; state != COLUMN_OPEN && n < count; n++)
        report->wound_height -= hits[n].step * hits[n].z;
    if (state == COLUMN_OPEN) {
        if ((size_t)report->open_count < report->room)
            report->open[report->open_count] = (int64_t)cell;
        report->open_count += 1;
    }
    if (state == COLUMN_INSIDE_OUT) {
        if (report->inside_out_count == 0)
            report->inside_out_first = (int64_t)cell;
        report->inside_out_count += 1;
    }
}

/* Intervals of the cells of a band, the first of which is `first`. */
static int32_t close_band(size_t first, size_t cells, Workspace *work, int64_t *offsets, IntervalList *list,
                          MeshReport *report) {
    if (hit_sort(&work->hits, cells, work->begin, &work->sorted) || interval_reserve(list, work->hits.count / 2))
        return COLUMNS_NO_MEMORY;
    for (size_t cell = 0; cell < cells; cell++) {
        const size_t begin = work->begin[cell], count = work->begin[cell + 1] - begin;
        if (count > 0) {
            Hit *hits = &work->sorted.hit[begin];
            count_column(column_close(hits, count, list), first + cell, hits, count, report);
        }
        offsets[first + cell + 1] = (int64_t)list->count;
    }
    return COLUMNS_DONE;
}

static int32_t close_bands(size_t nx, size_t ny, const Triangle *triangles, Bands *bands, Workspace *work,
                           int64_t *offsets, IntervalList *list, MeshReport *report) {
    offsets[0] = 0;
    for (size_t band = 0; band < bands->count; band++) {
        const size_t row = band * bands->rows, rows = nx - row < bands->rows ? nx - row : bands->rows;
        if (hit_band(nx, ny, triangles, bands, band, &work->hits) ||
            close_band(row * ny, rows * ny, work, offsets, list, report))
            return COLUMNS_NO_MEMORY;
    }
    interval_trim(list);
    return COLUMNS_DONE;
}

int32_t columns_of_mesh(size_t nx, size_t ny, size_t count, const Triangle *triangles, MeshReport *report,
                        int64_t *offsets, IntervalList *list) {
    Bands bands = {0};
    Workspace work = {0};
    report->occupied = report->open_count = report->inside_out_count = 0;
    report->inside_out_first = -1;
    report->wound_height = 0.0;
    int32_t result = start_bands(nx, ny, count, triangles, &bands);
    work.begin = malloc((bands.rows * ny + 1) * sizeof *work.begin);
    if (result == COLUMNS_DONE)
        result = work.begin ? close_bands(nx, ny, triangles, &bands, &work, offsets, list, report) : COLUMNS_NO_MEMORY;
    free(bands.head);
    free(bands.next);
    free(work.hits.hit);
    free(work.sorted.hit);
    free(work.begin);
    return result;
}
