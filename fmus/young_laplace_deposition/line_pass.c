#include "line_pass.h"

#include <string.h>

enum { ALIGNMENT = 16 };

/* The next `size` bytes of a block, NULL while only counting. */
static void *take(unsigned char *memory, size_t *used, size_t size) {
    void *place = memory ? memory + *used : NULL;
    *used += (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    return place;
}

size_t place_pass_memory(const FineSurface *s, void *memory, PassMemory *m) {
    const size_t columns = column_count(s), rows = row_count(s);
    const size_t widest = 2 * WIDEST_SPREAD * s->per_pitch + 3; /* rows of one line */
    const size_t nodes = columns * (widest < rows ? widest : rows), corners = s->nx * RAYS + 1;
    size_t used = 0;
    m->body.wet.nodes = take(memory, &used, nodes * sizeof(WettedNode));
    m->body.wet.along_x = take(memory, &used, rows * sizeof(Interval));
    m->body.wet.along_y = take(memory, &used, columns * sizeof(Interval));
    m->body.wet.first = take(memory, &used, (columns + 1) * sizeof(size_t));
    m->body.wet.lowest = take(memory, &used, columns * sizeof(size_t));
    m->body.depth = take(memory, &used, nodes * sizeof(double));
    m->body.force = take(memory, &used, nodes * sizeof(double));
    m->body.step = take(memory, &used, nodes * sizeof(double));
    m->body.response = take(memory, &used, nodes * sizeof(double));
    m->body.previous = take(memory, &used, nodes * sizeof(double));
    m->body.is_pinned = take(memory, &used, nodes * sizeof(bool));
    m->body.matrix = take(memory, &used, nodes * (widest + 2) * sizeof(double));
    m->before = take(memory, &used, columns * rows * sizeof(double));
    m->ends = take(memory, &used, corners * sizeof(Place));
    m->hull = take(memory, &used, corners * sizeof(Place));
    return used;
}

static Place site_of(const FineSurface *s, size_t i, size_t j) {
    const double first = (double)rim_points(s) + 0.5 * (double)s->per_pitch - 0.5;
    return (Place){first + (double)(i * s->per_pitch), first + (double)(j * s->per_pitch)};
}

static bool is_on_cells(const FineSurface *s, size_t point) {
    const size_t rim = rim_points(s), i = point / row_count(s), j = point % row_count(s);
    return i >= rim && i < column_count(s) - rim && j >= rim && j < row_count(s) - rim;
}

/* Lays the depths of a settled body onto the surface. */
static void lay(const FineSurface *s, const LiquidBody *body, PassReport *report) {
    for (size_t k = 0; k < body->wet.count; k++) {
        const size_t point = body->wet.nodes[k].point;
        s->height[point] += body->depth[k] * s->spacing;
        if (!is_on_cells(s, point))
            report->lost += body->depth[k] * s->spacing * s->spacing * s->spacing;
    }
}

/* Prints sites first .. end - 1 of a line as one body; `found` is the surface below. */
static void print_body(const FineSurface *s, const FineSurface *found, const Liquid *liquid, const double *drops,
                       size_t line, size_t first, size_t end, PassMemory *m, PassReport *report) {
    size_t ends = 0;
    double drop_count = 0.0;
    for (size_t i = first; i < end; i++) {
        const double drop = drops[i * s->ny + line];
        const double radius = cap_radius(drop * liquid->droplet_volume, liquid->contact_angle);
        spread_droplet(found, site_of(s, i, line), radius, m->ends + ends);
        ends += RAYS;
        drop_count += drop;
    }
    const size_t corners = convex_hull(m->ends, ends, m->hull);
    find_wetted_nodes(found, m->hull, corners, &m->body.wet);
    const double volume = drop_count * liquid->droplet_volume / (s->spacing * s->spacing * s->spacing);
    if (m->body.wet.count ==
        0) { /* a footprint smaller than the spacing of the points: all on the point next to the site */
        const Place site = site_of(s, first, line);
        s->height[(size_t)site.x * row_count(s) + (size_t)site.y] += volume * s->spacing;
        report->fallbacks++;
        return;
    }
    const bool is_settled = settle(&m->body, liquid->form, volume);
    if (!is_settled) {
        settle(&m->body, LINEAR, volume);
        report->fallbacks++;
    }
    lay(s, &m->body, report);
}

PassReport print_pass(const FineSurface *s, const Liquid *liquid, const double *drops, size_t line, size_t every,
                      PassMemory *m) {
    PassReport report = {0, 0.0};
    FineSurface found = *s;
    found.height = m->before;
    memcpy(m->before, s->height, column_count(s) * row_count(s) * sizeof *m->before);
    for (; line < s->ny; line += every) {
        for (size_t first = 0, end; first < s->nx; first = end + 1) {
            for (end = first; end < s->nx && drops[end * s->ny + line] > 0.0; end++)
                ;
            if (end > first)
                print_body(s, &found, liquid, drops, line, first, end, m, &report);
        }
    }
    return report;
}
