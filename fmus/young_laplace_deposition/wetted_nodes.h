/* The points of the fine surface inside a body's footprint, and their arms: to the next point inside, or to the
 * footprint's edge, which cuts grid lines exactly. Lengths in spacings of the fine surface. */
#ifndef INKLOOP_WETTED_NODES_H
#define INKLOOP_WETTED_NODES_H

#include "footprint.h"

#include <stdbool.h>
#include <stdint.h>

/* Arms of a node, along x and along y; the nodes are numbered across the line first (along y). */
enum { LEFT, RIGHT, DOWN, UP, ARMS };

typedef struct {
    int32_t next[ARMS]; /* the node at the end of an arm, -1 for the edge */
    double arm[ARMS];   /* lengths, up to 1 */
    double rise[ARMS];  /* slope of the substrate along each arm */
    size_t point;       /* in the fine surface */
} WettedNode;

typedef struct {
    double low, high;
} Interval;

typedef struct {
    /* bandwidth: the largest difference of the numbers of two nodes of one square of the grid */
    size_t count, bandwidth;
    WettedNode *nodes;
    Interval *along_x, *along_y; /* the footprint on each row and on each column of the fine surface */
    size_t *first, *lowest;      /* per column: its first node and that node's row */
} WettedNodes;

/* Finds all nodes inside a convex polygon on the present surface. */
void find_wetted_nodes(const FineSurface *surface, const Place *polygon, size_t corners, WettedNodes *found);

#endif
