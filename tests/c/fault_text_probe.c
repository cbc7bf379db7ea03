/* Texts of faults, a line each, by length first since they may hold anything but 0: what the emulator answers. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fault_text.h"

int main(void) {
    size_t length;
    while (scanf("%zu", &length) == 1 && getchar() == '\n') {
        char *text = malloc(length + 1), why[200] = "";
        if (!text || fread(text, 1, length, stdin) != length)
            return 1;
        text[length] = '\0';
        Fault fault = {0};
        const bool taken = fault_read(&fault, text, why, sizeof why);
        puts(taken ? "taken" : why);
        fflush(stdout);
        free(text);
    }
    return 0;
}
