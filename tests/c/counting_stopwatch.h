#ifndef COUNTING_STOPWATCH_H
#define COUNTING_STOPWATCH_H

/* Looks at the stopwatch so far: the core looks at it once in BAND_CELLS cells. */
double stopwatch_looks(void);

/* After so many looks more every one takes more time than any limit; infinite: none does. */
void hold_up_after(double more_looks);

#endif
