/* How the errors of the heights go with the displacement of the scans: the response, DISPLACEMENTS maps. */
#ifndef INKLOOP_DISPLACEMENT_RESPONSE_H
#define INKLOOP_DISPLACEMENT_RESPONSE_H

#include "scan_registration.h"

/* What the first scan, a map of heights, makes of the response: all of its slopes. False if there is no memory. */
bool first_response(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double *response);

enum { CARRIED = 64 }; /* cells at most */

/* The response of `count` cells from `first` on, after their heights took the shares `gain` of the innovation; `wall`:
 * number of walls before them, carried along. The response may stand where the one before did. What no displacement
 * explains any longer is added to the `variance` of these cells [m^2], if it is not NULL. */
void carry_response(size_t cells, size_t first, size_t count, const RegisteredScan *registered, size_t *wall,
                    const double *before, const double *gain, double *response, double *variance);

#endif
