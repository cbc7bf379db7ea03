/* Invariants of columns under random input: closed meshes close every column, any triangles are survived, unions,
 * intersections and differences are those of their points. Prints the first that is broken. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "column_algebra.h"
#include "column_hits.h"
#include "mesh_columns.h"

enum { SIDE_MAX = 400, TRIANGLES_MAX = 64, INTERVALS_MAX = 200 };

static uint64_t state = 1;

/* 0 .. below - 1, by Marsaglia's xorshift. */
static size_t whole(size_t below) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (size_t)(state >> 11) % below;
}

static double share(void) {
    return (double)whole(1u << 30) / (double)(1u << 30);
}

/* Numbers that lie on rows and centres, between them, far away, or are none. */
static double coordinate(size_t side, bool is_tame) {
    switch (whole(is_tame ? 3 : 6)) {
    case 0:
        return (double)whole(side + 4) - 2.0;
    case 1:
        return (double)whole(2 * side) / 2.0;
    case 2:
        return share() * (double)(side + 4) - 2.0;
    case 3:
        return share() < 0.5 ? 1e300 : -1e300;
    case 4:
        return share() < 0.5 ? DBL_MAX : -INFINITY;
    default:
        return share() < 0.5 ? NAN : DBL_TRUE_MIN;
    }
}

static Corner corner(size_t nx, size_t ny, bool is_tame) {
    return (Corner){coordinate(nx, is_tame), coordinate(ny, is_tame), coordinate(9, is_tame)};
}

static void fail(const char *invariant) {
    printf("%s\n", invariant);
    exit(1);
}

static Columns view(const int64_t *offsets, const IntervalList *list) {
    return (Columns){offsets, list->bottom, list->top};
}

static void release(IntervalList *list) {
    columns_release(list->bottom);
    columns_release(list->top);
    *list = (IntervalList){0};
}

/* The four faces of a tetrahedron, to the outside or all to the inside. */
static void tetrahedron(size_t nx, size_t ny, Triangle *faces) {
    Corner c[4];
    for (int n = 0; n < 4; n++)
        c[n] = corner(nx, ny, true);
    faces[0] = (Triangle){{c[0], c[1], c[2]}};
    faces[1] = (Triangle){{c[0], c[3], c[1]}};
    faces[2] = (Triangle){{c[1], c[3], c[2]}};
    faces[3] = (Triangle){{c[2], c[3], c[0]}};
}

static void check_mesh(bool is_closed) {
    static Triangle triangles[TRIANGLES_MAX];
    static int64_t offsets[SIDE_MAX * SIDE_MAX + 1];
    int64_t open[3];
    const size_t side = whole(20) ? 12 : SIDE_MAX, nx = 1 + whole(side), ny = 1 + whole(side);
    const size_t count = 4 * (1 + whole(TRIANGLES_MAX / 4));
    for (size_t n = 0; n < count; n += 4) {
        tetrahedron(nx, ny, &triangles[n]);
        if (!is_closed)
            for (size_t k = 0; k < 4; k++)
                triangles[n + k].corner[whole(3)] = corner(nx, ny, false);
    }
    IntervalList list = {0};
    MeshReport report = {open, 3, 0, 0, 0, 0, 0.0};
    if (columns_of_mesh(nx, ny, count, triangles, &report, offsets, &list))
        fail("a mesh finds memory");
    if (is_closed && report.open_count > 0)
        fail("closed meshes close every column");
    const Columns columns = view(offsets, &list);
    if (is_closed && columns_check(nx * ny, list.count, &columns) >= 0)
        fail("intervals of a mesh ascend");
    for (size_t k = 0; is_closed && k < list.count; k++)
        if (list.bottom[k] < -2.0 || list.top[k] > 11.0)
            fail("columns stay within the corners");
    release(&list);
}

static bool is_in(const Columns *columns, int64_t cell, double z) {
    uint8_t inside;
    columns_inside(columns, 1, &cell, &z, &inside);
    return inside;
}

/* Random intervals on whole heights, so that ends coincide. */
static void random_columns(size_t cells, int64_t *offsets, IntervalList *list, const char *invariant) {
    static int64_t cell[INTERVALS_MAX];
    static double bottom[INTERVALS_MAX], top[INTERVALS_MAX];
    const size_t count = whole(INTERVALS_MAX);
    for (size_t n = 0; n < count; n++) {
        cell[n] = (int64_t)whole(cells);
        bottom[n] = (double)whole(12);
        top[n] = (double)whole(12);
    }
    if (columns_union(cells, count, cell, bottom, top, offsets, list))
        fail("a union finds memory");
    const Columns columns = view(offsets, list);
    if (columns_check(cells, list->count, &columns) >= 0)
        fail(invariant);
    for (size_t c = 0; c < cells; c++)
        for (double z = -0.5; z < 12.0; z += 0.5) {
            bool expected = false;
            for (size_t n = 0; n < count; n++)
                expected |= cell[n] == (int64_t)c && bottom[n] <= z && z < top[n];
            if (expected != is_in(&columns, (int64_t)c, z))
                fail("a union has the points of its intervals");
        }
}

static void check_algebra(void) {
    enum { CELLS = 8 };
    int64_t offsets[3][CELLS + 1];
    IntervalList lists[3] = {{0}};
    random_columns(CELLS, offsets[0], &lists[0], "a union ascends");
    random_columns(CELLS, offsets[1], &lists[1], "a union ascends");
    const Columns a = view(offsets[0], &lists[0]), b = view(offsets[1], &lists[1]);
    const int32_t rule = (int32_t)whole(8);
    if (columns_combine(CELLS, &a, &b, rule, offsets[2], &lists[2]))
        fail("a combination finds memory");
    const Columns both = view(offsets[2], &lists[2]);
    if (columns_check(CELLS, lists[2].count, &both) >= 0)
        fail("combined intervals ascend");
    for (int64_t c = 0; c < CELLS; c++)
        for (double z = -0.5; z < 12.0; z += 0.5) {
            const bool in_a = is_in(&a, c, z), in_b = is_in(&b, c, z);
            const bool expected = (in_a && in_b && (rule & POINTS_OF_BOTH)) ||
                                  (in_a && !in_b && (rule & POINTS_OF_FIRST_ONLY)) ||
                                  (!in_a && in_b && (rule & POINTS_OF_SECOND_ONLY));
            if (expected != is_in(&both, c, z))
                fail("a combination has the points of its rule");
        }
    for (int n = 0; n < 3; n++)
        release(&lists[n]);
}

int main(void) {
    for (int n = 0; n < 2000; n++) {
        check_mesh(true);
        check_mesh(false);
    }
    for (int n = 0; n < 500; n++)
        check_algebra();
    return 0;
}
