#include "text.h"

#include <math.h>
#include <string.h>

pma_text pma_text_begin(char *bytes, size_t size)
{
    bytes[0] = 0;
    return (pma_text){bytes, size};
}

void pma_text_some(pma_text *t, const char *word, size_t most)
{
    size_t length = 0;
    while (length < most && word[length])
        length++;
    if (length >= t->left)
        length = t->left - 1;
    memcpy(t->next, word, length);
    t->next += length;
    t->left -= length;
    *t->next = 0;
}

void pma_text_word(pma_text *t, const char *word)
{
    pma_text_some(t, word, SIZE_MAX);
}

/* ---- numbers -------------------------------------------------------------------------------- */

enum { DIGITS = 9, MOST = 20 };

void pma_text_integer(pma_text *t, int64_t x)
{
    char digits[MOST + 1] = {0}, *first = digits + MOST;
    uint64_t left = x < 0 ? 0 - (uint64_t)x : (uint64_t)x;
    do
        *--first = (char)('0' + left % 10);
    while (left /= 10);
    pma_text_word(t, x < 0 ? "-" : "");
    pma_text_word(t, first);
}

/* x 10^n, by powers that doubles have exactly */
static double scaled(double x, int n)
{
    for (; n > 22; n -= 22)
        x *= 1e22;
    for (; n < -22; n += 22)
        x /= 1e22;
    double power = 1.0;
    for (int i = 0; i < (n < 0 ? -n : n); i++)
        power *= 10.0;
    return n < 0 ? x / power : x * power;
}

/* Nine digits of x > 0, without zeros at their end, and the exponent of the first. */
static int digits_of(double x, char *out)
{
    int exponent = (int)floor(log10(x));
    double digits = nearbyint(scaled(x, DIGITS - 1 - exponent));
    if (digits >= 1e9 || digits < 1e8) {
        exponent += digits >= 1e9 ? 1 : -1;
        digits = nearbyint(scaled(x, DIGITS - 1 - exponent));
    }
    uint64_t left = (uint64_t)digits;
    for (int i = DIGITS - 1; i >= 0; left /= 10)
        out[i--] = (char)('0' + left % 10);
    int last = DIGITS;
    while (last > 1 && out[last - 1] == '0')
        last--;
    out[last] = 0;
    return exponent;
}

/* d.ddde-05 */
static void write_power(pma_text *t, const char *digits, int exponent)
{
    const int size = exponent < 0 ? -exponent : exponent;
    pma_text_some(t, digits, 1);
    pma_text_word(t, digits[1] ? "." : "");
    pma_text_word(t, digits + 1);
    pma_text_word(t, exponent < 0 ? "e-" : "e+");
    pma_text_word(t, size < 10 ? "0" : "");
    pma_text_integer(t, size);
}

/* 0.000ddd, dd.ddd or ddd000 */
static void write_plain(pma_text *t, const char *digits, int exponent)
{
    const size_t count = strlen(digits), whole = exponent < 0 ? 0 : (size_t)exponent + 1;
    pma_text_word(t, exponent < 0 ? "0." : "");
    for (int i = exponent; i < -1; i++)
        pma_text_word(t, "0");
    pma_text_some(t, digits, whole);
    for (size_t i = count; i < whole; i++)
        pma_text_word(t, "0");
    if (count > whole) {
        pma_text_word(t, whole > 0 ? "." : "");
        pma_text_word(t, digits + whole);
    }
}

void pma_text_real(pma_text *t, double x)
{
    char digits[DIGITS + 1];
    pma_text_word(t, signbit(x) ? "-" : "");
    if (!isfinite(x) || x == 0.0) {
        pma_text_word(t, isnan(x) ? "nan" : x == 0.0 ? "0" : "inf");
        return;
    }
    const int exponent = digits_of(fabs(x), digits);
    if (exponent < -4 || exponent >= DIGITS)
        write_power(t, digits, exponent);
    else
        write_plain(t, digits, exponent);
}
