/* text.h - messages, without the input and output of the C library, which not every system has. */
#ifndef PMA_TEXT_H
#define PMA_TEXT_H

#include <stddef.h>
#include <stdint.h>

/* The end of a text, and the bytes behind it. What does not fit is cut off. */
typedef struct {
    char *next;
    size_t left; /* the closing zero included */
} pma_text;

/* An empty text in `size` bytes, at least 1. */
pma_text pma_text_begin(char *bytes, size_t size);

void pma_text_word(pma_text *t, const char *word);
void pma_text_some(pma_text *t, const char *word, size_t most); /* at most so many bytes of it */
void pma_text_integer(pma_text *t, int64_t x);
void pma_text_real(pma_text *t, double x); /* of nine digits, as printf has it by %.9g */

#endif
