/* What the bridge (bridge.c, on Linux) and the host (host.c, in Wine) say to each other, on the host's standard input
 * and output. A call is answered by any number of log messages and then by one result; both sides are of one machine,
 * so that numbers keep their bytes. */
#include <stdint.h>

enum {
    OP_INSTANTIATE = 1, /* i32 visible, i32 logging, then name, guid, resources: texts with a zero at the end */
    OP_SETUP,           /* i32 tolerance defined, i32 stop time defined, double tolerance, start, stop */
    OP_ENTER,
    OP_EXIT,
    OP_TERMINATE,
    OP_RESET,
    OP_FREE,
    OP_DEBUG,     /* i32 on */
    OP_GET,       /* i32 type, u32 n, u32 references[n] -> values */
    OP_SET,       /* i32 type, u32 n, u32 references[n], values; texts with a zero at the end */
    OP_STEP,      /* double time, step, i32 no earlier state, i32 unused */
    OP_GET_STATE, /* u64 state -> u64 state */
    OP_SET_STATE,
    OP_FREE_STATE,
    OP_DERIVATIVE, /* u32 n, u32 m, u32 unknowns[n], u32 knowns[m], double seeds[m] -> double[n] */
};
enum { TYPE_REAL, TYPE_INTEGER, TYPE_BOOLEAN, TYPE_STRING };
enum { KIND_LOG = 1, KIND_RESULT };
enum { STATUS_OK = 0, STATUS_ERROR = 3, STATUS_FATAL = 4 };

typedef struct {
    uint32_t op, size; /* bytes that follow */
} Call;

typedef struct {
    uint32_t kind, size; /* bytes that follow; of a log message: category and message */
    int32_t status, unused;
} Answer;
