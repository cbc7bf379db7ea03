#include "wetted_nodes.h"

#include <math.h>

/* least length of an arm in spacings; a point closer to the edge counts as the edge */
static const double NEAREST = 1e-3;

typedef struct {
    size_t first, end;
} Range;

/* Grid lines that a span meets. */
static Range lines_of(double low, double high) {
    return (Range){(size_t)ceil(low), (size_t)floor(high) + 1};
}

static double at(Place p, int axis) {
    return axis == 0 ? p.x : p.y;
}

/* Interval of each grid line across `axis` inside the polygon, and the range of lines that meet it. */
static Range cut_lines(const Place *polygon, size_t corners, int axis, Interval *cut) {
    double low = INFINITY, high = -INFINITY;
    for (size_t k = 0; k < corners; k++) {
        low = fmin(low, at(polygon[k], axis));
        high = fmax(high, at(polygon[k], axis));
    }
    const Range lines = lines_of(low, high);
    for (size_t line = lines.first; line < lines.end; line++)
        cut[line] = (Interval){INFINITY, -INFINITY};
    for (size_t k = 0; k < corners; k++) {
        const Place a = polygon[k], b = polygon[(k + 1) % corners];
        const double from = at(a, axis), to = at(b, axis);
        const Range met = lines_of(fmin(from, to), fmax(from, to));
        for (size_t line = met.first; line < met.end; line++) {
            const double share = from == to ? 0.0 : ((double)line - from) / (to - from);
            const double place = at(a, 1 - axis) + share * (at(b, 1 - axis) - at(a, 1 - axis));
            cut[line].low = fmin(cut[line].low, place);
            cut[line].high = fmax(cut[line].high, place);
        }
    }
    return lines;
}

static bool is_inside(Interval cut, size_t place) {
    return (double)place > cut.low + NEAREST && (double)place < cut.high - NEAREST;
}

static double length_to(double distance, bool is_edge) {
    return is_edge && distance < 1.0 ? distance : 1.0;
}

static void measure_arms(const FineSurface *surface, const WettedNodes *found, WettedNode *node, size_t i, size_t j) {
    const size_t rows = row_count(surface);
    const size_t ends[ARMS] = {node->point - rows, node->point + rows, node->point - 1, node->point + 1};
    const Interval x = found->along_x[j], y = found->along_y[i];
    const double distance[ARMS] = {(double)i - x.low, x.high - (double)i, (double)j - y.low, y.high - (double)j};
    for (int arm = 0; arm < ARMS; arm++) {
        node->arm[arm] = length_to(distance[arm], node->next[arm] < 0);
        node->rise[arm] = (surface->height[ends[arm]] - surface->height[node->point]) / surface->spacing;
    }
}

/* Numbers the nodes column by column. A convex footprint meets a column in one piece. */
static void number_nodes(const FineSurface *surface, Range columns, WettedNodes *found) {
    found->count = 0;
    for (size_t i = columns.first; i < columns.end; i++) {
        found->first[i] = found->count;
        found->lowest[i] = 0;
        const Range rows = lines_of(found->along_y[i].low, found->along_y[i].high);
        for (size_t j = rows.first; j < rows.end; j++) {
            if (!is_inside(found->along_y[i], j) || !is_inside(found->along_x[j], i))
                continue;
            if (found->count == found->first[i])
                found->lowest[i] = j;
            found->nodes[found->count++].point = i * row_count(surface) + j;
        }
    }
    found->first[columns.end] = found->count;
}

/* The node at (i, j), -1 if there is none. */
static int32_t node_at(const WettedNodes *found, Range columns, size_t i, size_t j) {
    if (i < columns.first || i >= columns.end || j < found->lowest[i])
        return -1;
    const size_t node = found->first[i] + j - found->lowest[i];
    return node < found->first[i + 1] ? (int32_t)node : -1;
}

void find_wetted_nodes(const FineSurface *surface, const Place *polygon, size_t corners, WettedNodes *found) {
    cut_lines(polygon, corners, 1, found->along_x);
    const Range columns = cut_lines(polygon, corners, 0, found->along_y);
    number_nodes(surface, columns, found);
    size_t widest = 0;
    for (size_t k = 0; k < found->count; k++) {
        WettedNode *node = &found->nodes[k];
        const size_t i = node->point / row_count(surface), j = node->point % row_count(surface);
        node->next[LEFT] = node_at(found, columns, i - 1, j);
        node->next[RIGHT] = node_at(found, columns, i + 1, j);
        node->next[DOWN] = node_at(found, columns, i, j - 1);
        node->next[UP] = node_at(found, columns, i, j + 1);
        measure_arms(surface, found, node, i, j);
        if (node->next[RIGHT] >= 0 && (size_t)node->next[RIGHT] - k > widest)
            widest = (size_t)node->next[RIGHT] - k;
    }
    found->bandwidth = widest + 1; /* and one further to a diagonal neighbour */
}
