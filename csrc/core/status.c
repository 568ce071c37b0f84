#include "status.h"

#include <stddef.h>

const char *pma_status_text(pma_status status)
{
#define PMA_STATUS_TEXT(code, text) text,
    static const char *const texts[] = {PMA_STATUS_LIST(PMA_STATUS_TEXT)};
#undef PMA_STATUS_TEXT
    size_t index = (size_t)status;
    return index < sizeof texts / sizeof texts[0] ? texts[index] : "unknown status";
}
