/* A triangle mesh as columns: where the winding number of its surface is above 0.
 *
 * Rows lie along j. Where an edge crosses a row is computed from the edge's lower end, so that both of its triangles
 * get the same bits; rows and cells are half open. In a closed mesh every row meets as many edges going up as down at
 * each of these points, and so the winding number above every column is 0, whatever rounding does.
 */
#ifndef INKLOOP_MESH_COLUMNS_H
#define INKLOOP_MESH_COLUMNS_H

#include "columns.h"

/* x, y in cells: the centre of cell (i, j) is at (i, j); z [m]. All finite. */
typedef struct {
    double x, y, z;
} Corner;

typedef struct {
    Corner corner[3]; /* counterclockwise from outside */
} Triangle;

/* Columns whose winding number is wrong. `open` of the caller holds the first `room` open cells in ascending order. */
typedef struct {
    int64_t *open;
    size_t room;
    int64_t occupied;         /* columns that the mesh hits */
    int64_t open_count;       /* columns with another winding number than 0 above all hits; they have no interval */
    int64_t inside_out_count; /* columns with a winding number below 0 and none above 0 */
    int64_t inside_out_first; /* the first of these, -1 if there is none */
    double wound_height;      /* winding number times height, over all columns that are not open [m] */
} MeshReport;

/* Columns of a mesh, without its parts outside the grid; count < 2^32. offsets: nx * ny + 1 of the result. COLUMNS_DONE
 * or COLUMNS_NO_MEMORY. */
COLUMNS_API int32_t columns_of_mesh(size_t nx, size_t ny, size_t count, const Triangle *triangles, MeshReport *report,
                                    int64_t *offsets, IntervalList *list);

#endif
