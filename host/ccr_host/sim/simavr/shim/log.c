#include "parts.h"

#include <stdlib.h>
#include <string.h>

void log_add(log_t *log, const void *record) {
    if (log->count == log->room) {
        log->room = log->room ? 2 * log->room : 64;
        log->records = realloc(log->records, log->room * log->record_size);
    }
    memcpy((char *)log->records + log->count++ * log->record_size, record, log->record_size);
}

size_t log_take(log_t *log, void *out, size_t room) {
    const size_t taken = log->count < room ? log->count : room;
    if (taken == 0) return 0;
    memcpy(out, log->records, taken * log->record_size);
    log->count -= taken;
    memmove(log->records, (char *)log->records + taken * log->record_size,
            log->count * log->record_size);
    return taken;
}
