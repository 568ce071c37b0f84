// loop.cpp - a frozen model in C++: prints the first output after some fine steps.
//
//     c++ loop.cpp $(pkg-config --cflags --libs pmalpha) -o loop && ./loop model.pma 1000
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <pmalpha.h>

int main(int count, char **words)
{
    pmalpha_model *opened = nullptr;
    char why[PMALPHA_MESSAGE] = "which model?";
    if (count < 3 || pmalpha_open(words[1], why, &opened) != PMALPHA_OK)
        return std::fprintf(stderr, "%s\n", why), 1;
    const std::unique_ptr<pmalpha_model, void (*)(pmalpha_model *)> m(opened, pmalpha_close);
    for (long k = 0; k < std::atol(words[2]); k++) {
        double d[3];
        pmalpha_command(m.get(), 0, d);
        if (pmalpha_set(m.get(), 0, 300.0 * d[0]) != PMALPHA_OK ||
            pmalpha_advance(m.get(), 1) != PMALPHA_OK)
            return std::fprintf(stderr, "%s\n", pmalpha_message(m.get())), 1;
    }
    std::printf("%.17g\n", pmalpha_get(m.get(), 0));
}
