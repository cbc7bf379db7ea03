/* Routines (0x31): the steps of the node, each for one (job, layer, pass, attempt).
 *
 *     31 01 routine (2) job (4) layer (2) pass attempt [option]   begin: answered when done, 7F 31 78 meanwhile
 *     31 03 routine (2) job (4) layer (2) pass attempt            its outcome; changes nothing
 *     71 kind routine (2) outcome job (4) layer (2) pass attempt
 *
 * A pass, cure or scan that is done is answered "done before" and nothing is changed, whatever the attempt (a scan: of
 * the same attempt; a higher one scans again). The same holds for homing, move and purge, if it was the last of them.
 *
 *     clear    option: 1 a person confirms, 2 the open layer is abandoned, 3 both; a journal that could not be read
 *              needs 3, and its job is over
 *     pass     option: colour 0-3 of fmus/deposition/pass_colour.h; 255 all, for layers of one pass
 *     cure     option (2): milliseconds
 *     move     option: station 0 home, 1 print, 2 cure, 3 scan
 *     dry run  option: 1 begins a dry run: nothing is jetted, lit or written to the journal; 0 ends it */
#ifndef INKLOOP_ROUTINES_H
#define INKLOOP_ROUTINES_H

#include "uds.h"

enum { CLEAR_OPERATOR = 1, CLEAR_ABANDON = 2 };
enum { COLOUR_COUNT = 4, ALL_COLOURS = 255, STATION_COUNT = 4 };

/* The length of the answer. `cause` is set if the node has to go off: a step could not begin, the journal is damaged.
 */
size_t routine_control(Node *node, const uint8_t *request, size_t length, uint8_t *answer, Cause *cause);

#endif
