/* FMI 3.0 co-simulation that gives back what it is given, in every type that is a number.
 *
 * Value references: input 2 k, output 2 k + 1, k = 0 ... 11 for Float64, Float32, Int8, UInt8, Int16, UInt16, Int32,
 * UInt32, Int64, UInt64, Boolean, Enumeration (64 bits). The input u of Int16 is an array of two.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *Instance;
typedef uint32_t Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;
typedef struct { int64_t cells[12][2]; } Slave;

#define SIZE(reference) ((reference) / 2 == 4 ? 2u : 1u)
#define ACCESS(Name, Type, first, second)                                                                             \
    EXPORT Status fmi3Set##Name(Instance c, const Reference r[], size_t n, const Type v[], size_t count) {            \
        for (size_t i = 0; i < n; i++) {                                                                              \
            if (r[i] % 2 || (r[i] / 2 != first && r[i] / 2 != second)) return ERROR;                                  \
            for (unsigned k = 0; k < SIZE(r[i]); k++, count--) *(Type *)&((Slave *)c)->cells[r[i] / 2][k] = *v++;     \
        }                                                                                                             \
        return count ? ERROR : OK;                                                                                    \
    }                                                                                                                 \
    EXPORT Status fmi3Get##Name(Instance c, const Reference r[], size_t n, Type v[], size_t count) {                  \
        for (size_t i = 0; i < n; i++) {                                                                              \
            if (!(r[i] % 2) || (r[i] / 2 != first && r[i] / 2 != second)) return ERROR;                               \
            for (unsigned k = 0; k < SIZE(r[i]); k++, count--) *v++ = *(Type *)&((Slave *)c)->cells[r[i] / 2][k];     \
        }                                                                                                             \
        return count ? ERROR : OK;                                                                                    \
    }
ACCESS(Float64, double, 0, 0)
ACCESS(Float32, float, 1, 1)
ACCESS(Int8, int8_t, 2, 2)
ACCESS(UInt8, uint8_t, 3, 3)
ACCESS(Int16, int16_t, 4, 4)
ACCESS(UInt16, uint16_t, 5, 5)
ACCESS(Int32, int32_t, 6, 6)
ACCESS(UInt32, uint32_t, 7, 7)
ACCESS(Int64, int64_t, 8, 11)
ACCESS(UInt64, uint64_t, 9, 9)
ACCESS(Boolean, bool, 10, 10)

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                            bool logging, bool events, bool early, const Reference needed[], size_t n,
                                            void *environment, void *log, void *update) {
    return calloc(1, sizeof(Slave));
}
EXPORT void fmi3FreeInstance(Instance c) { free(c); }
EXPORT Status fmi3EnterInitializationMode(Instance c, bool td, double tol, double t0, bool sd, double t1) { return OK; }
EXPORT Status fmi3ExitInitializationMode(Instance c) { return OK; }
EXPORT Status fmi3DoStep(Instance c, double t, double h, bool keep, bool *event, bool *end, bool *early, double *last) {
    *last = t + h;
    *event = *end = *early = false;
    return OK;
}
