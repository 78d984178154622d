/* The functions of an FMU (FMI 2.0, co-simulation) whose library is one for Windows: each instance is a process of Wine
 * that does the calls; see protocol.h. Beside this library lies host.exe; the FMU's own one is found from the location
 * of its resources. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fmi2Functions.h"
#include "protocol.h"

enum { LOOK_MS = 100 }; /* how often it is looked whether the host still runs, while nothing comes */

typedef struct {
    int calls, answers; /* ends of pipes */
    pid_t host;
    const fmi2CallbackFunctions *callbacks;
    char *name;
    char *texts;      /* what the strings of the last fmi2GetString point to */
    size_t room;
    int is_lost;
} Instance;

static int sent(Instance *own, const void *source, size_t size) {
    for (const char *at = source; size;) {
        const ssize_t count = write(own->calls, at, size);
        if (count <= 0) return 0;
        at += count;
        size -= (size_t)count;
    }
    return 1;
}

/* Whether something can be read. The end of the pipe alone would not tell that the host has ended: what Wine has started
 * with it, and goes on for a while, holds that end, too. */
static int comes(Instance *own) {
    struct pollfd end = {own->answers, POLLIN, 0};
    while (poll(&end, 1, LOOK_MS) == 0) {
        if (own->host > 0 && waitpid(own->host, NULL, WNOHANG) == own->host) {
            own->host = 0;
            return poll(&end, 1, 0) > 0; /* its last words */
        }
        if (own->host <= 0) return 0;
    }
    return 1;
}

static int received(Instance *own, void *target, size_t size) {
    for (char *at = target; size;) {
        const ssize_t count = comes(own) ? read(own->answers, at, size) : 0;
        if (count <= 0) return 0;
        at += count;
        size -= (size_t)count;
    }
    return 1;
}

/* The message is the format itself, with its % doubled: some callers print it as it is. */
static void say(Instance *own, fmi2Status status, const char *category, const char *message) {
    const fmi2CallbackFunctions *to = own->callbacks;
    char *text = to && to->logger ? malloc(2 * strlen(message) + 1) : NULL, *end = text;
    if (!text) return;
    for (const char *at = message; *at; at++) {
        *end++ = *at;
        if (*at == '%') *end++ = '%';
    }
    *end = 0;
    to->logger(to->componentEnvironment, own->name, status, category, text);
    free(text);
}

static fmi2Status lost(Instance *own) {
    if (!own->is_lost) say(own, fmi2Fatal, "error", "The process of Wine that runs the FMU has ended.");
    own->is_lost = 1;
    return fmi2Fatal;
}

/* The answer to a call: its values into target, of at most size bytes, or, where grown is given, into its memory. */
static fmi2Status answered(Instance *own, void *target, size_t size, int grown) {
    for (Answer head;;) {
        if (!received(own, &head, sizeof head)) return lost(own);
        if (head.kind == KIND_LOG) {
            char *text = malloc((size_t)head.size + 1);
            if (!text || !received(own, text, head.size)) {
                free(text);
                return lost(own);
            }
            text[head.size] = 0;
            say(own, (fmi2Status)head.status, text, text + strlen(text) + 1);
            free(text);
            continue;
        }
        if (grown && head.size + 1 > own->room) {
            own->texts = realloc(own->texts, own->room = 2 * (size_t)head.size + 64);
            if (!own->texts) return lost(own);
        }
        if (grown) target = own->texts, size = own->room;
        if (head.size > size || !received(own, target, head.size)) return lost(own);
        return (fmi2Status)head.status;
    }
}

static fmi2Status called(Instance *own, uint32_t op, const void *first, size_t one, const void *second, size_t two,
                         const void *third, size_t three, void *target, size_t size) {
    const Call head = {op, (uint32_t)(one + two + three)};
    if (own->is_lost) return fmi2Fatal;
    if (!sent(own, &head, sizeof head) || !sent(own, first, one) || !sent(own, second, two) || !sent(own, third, three))
        return lost(own);
    return answered(own, target, size, op == OP_GET && target == NULL);
}

static fmi2Status plainly(fmi2Component c, uint32_t op) { return called(c, op, NULL, 0, NULL, 0, NULL, 0, "", 0); }

/* Z:\...\binaries\win64\name.dll from file:///.../resources */
static char *library_of(const char *resources) {
    const char *at = strncmp(resources, "file://", 7) ? resources : resources + 7;
    char *path = malloc(strlen(at) + 64 + sizeof MODEL_IDENTIFIER), *to = path;
    if (!path) return NULL;
    *to++ = 'Z', *to++ = ':';
    for (; *at; at++) {
        unsigned code = 0;
        if (*at == '%' && sscanf(at + 1, "%2x", &code) == 1) *to++ = (char)code, at += 2;
        else *to++ = *at == '/' ? '\\' : *at;
    }
    while (to[-1] == '\\') to--;
    *to = 0;
    char *end = strrchr(path, '\\');
    sprintf(end ? end : to, "\\binaries\\win64\\%s.dll", MODEL_IDENTIFIER);
    return path;
}

static pid_t started(const char *library, int calls[2], int answers[2]) {
    Dl_info here;
    char host[4096];
    if (!dladdr((void *)&started, &here)) return -1;
    const char *end = strrchr(here.dli_fname, '/');
    snprintf(host, sizeof host, "%.*s/host.exe", end ? (int)(end - here.dli_fname) : 1, end ? here.dli_fname : ".");
    if (pipe2(calls, O_CLOEXEC) || pipe2(answers, O_CLOEXEC)) return -1; /* hosts must not hold each other's ends */
    setenv("WINEDEBUG", "-all", 0);
    const pid_t child = fork();
    if (child == 0) {
        dup2(calls[0], 0);
        dup2(answers[1], 1);
        execlp("wine", "wine", host, library, (char *)NULL);
        _exit(127);
    }
    close(calls[0]), close(answers[1]);
    return child;
}

static void freed(Instance *own) {
    close(own->calls), close(own->answers);
    if (own->host > 0) {
        if (own->is_lost) kill(own->host, SIGKILL);
        waitpid(own->host, NULL, 0);
    }
    free(own->name), free(own->texts), free(own);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Instance *own = calloc(1, sizeof *own);
    char *library = resources ? library_of(resources) : NULL;
    if (!own || !library || type != fmi2CoSimulation) {
        free(own), free(library);
        return NULL;
    }
    own->callbacks = callbacks;
    own->name = strdup(name);
    int calls[2] = {-1, -1}, answers[2] = {-1, -1};
    own->host = started(library, calls, answers);
    own->calls = calls[1], own->answers = answers[0];
    const int32_t flags[2] = {visible, logging};
    const size_t first = strlen(name) + 1, second = strlen(guid) + 1, third = strlen(resources) + 1;
    /* Windows knows the resources by another path; of the URI only the drive is new. */
    char *texts = malloc(first + second + third + 8);
    fmi2Status status = own->host > 0 && texts ? answered(own, NULL, 0, 0) : fmi2Fatal;
    if (status != fmi2OK) say(own, fmi2Error, "error", "Wine could not load the library of the FMU.");
    if (status == fmi2OK) {
        memcpy(texts, name, first);
        memcpy(texts + first, guid, second);
        const int is_uri = !strncmp(resources, "file:///", 8);
        const int length = sprintf(texts + first + second, "%s%s", is_uri ? "file:///Z:/" : "", resources + (is_uri ? 8 : 0));
        status = called(own, OP_INSTANTIATE, flags, sizeof flags, texts, first + second + (size_t)length + 1, NULL, 0, "", 0);
    }
    free(texts), free(library);
    if (status == fmi2OK) return own;
    own->is_lost = 1;
    freed(own);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
    if (!c) return;
    plainly(c, OP_FREE);
    freed(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop) {
    const int32_t flags[2] = {tolerant, stops};
    const double numbers[3] = {tolerance, start, stop};
    return called(c, OP_SETUP, flags, sizeof flags, numbers, sizeof numbers, NULL, 0, "", 0);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return plainly(c, OP_ENTER); }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return plainly(c, OP_EXIT); }
fmi2Status fmi2Terminate(fmi2Component c) { return plainly(c, OP_TERMINATE); }
fmi2Status fmi2Reset(fmi2Component c) { return plainly(c, OP_RESET); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    (void)count, (void)categories;
    const int32_t flag = on;
    return called(c, OP_DEBUG, &flag, sizeof flag, NULL, 0, NULL, 0, "", 0);
}

static fmi2Status got(fmi2Component c, int32_t type, const fmi2ValueReference references[], size_t count, void *values,
                      size_t size) {
    const int32_t head[2] = {type, (int32_t)count};
    return called(c, OP_GET, head, sizeof head, references, count * sizeof *references, NULL, 0, values, count * size);
}

static fmi2Status put(fmi2Component c, int32_t type, const fmi2ValueReference references[], size_t count,
                      const void *values, size_t size) {
    const int32_t head[2] = {type, (int32_t)count};
    return called(c, OP_SET, head, sizeof head, references, count * sizeof *references, values, size, "", 0);
}

#define VALUES(name, own, type)                                                                                        \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, own values[]) {                 \
        return got(c, type, vr, n, values, sizeof *values);                                                            \
    }                                                                                                                  \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, const own values[]) {           \
        return put(c, type, vr, n, values, n * sizeof *values);                                                        \
    }

VALUES(Real, fmi2Real, TYPE_REAL)
VALUES(Integer, fmi2Integer, TYPE_INTEGER)
VALUES(Boolean, fmi2Boolean, TYPE_BOOLEAN)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String values[]) {
    Instance *own = c;
    const fmi2Status status = got(c, TYPE_STRING, vr, n, NULL, 0);
    const char *at = own->texts;
    for (size_t i = 0; i < n && status < fmi2Error; i++) values[i] = at, at += strlen(at) + 1;
    return status;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String values[]) {
    size_t size = 0, used = 0;
    for (size_t i = 0; i < n; i++) size += strlen(values[i]) + 1;
    char *texts = malloc(size + 1);
    if (!texts) return fmi2Error;
    for (size_t i = 0; i < n; i++) used += (size_t)sprintf(texts + used, "%s", values[i]) + 1;
    const fmi2Status status = put(c, TYPE_STRING, vr, n, texts, size);
    free(texts);
    return status;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    const double numbers[2] = {time, step};
    const int32_t flags[2] = {final, 0};
    return called(c, OP_STEP, numbers, sizeof numbers, flags, sizeof flags, NULL, 0, "", 0);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n,
                                        const fmi2ValueReference knowns[], size_t m, const fmi2Real seeds[],
                                        fmi2Real values[]) {
    const size_t size = 8 + 4 * (n + m);
    char *head = malloc(size + 1);
    if (!head) return fmi2Error;
    const uint32_t counts[2] = {(uint32_t)n, (uint32_t)m};
    memcpy(head, counts, 8);
    memcpy(head + 8, unknowns, 4 * n);
    memcpy(head + 8 + 4 * n, knowns, 4 * m);
    const fmi2Status status = called(c, OP_DERIVATIVE, head, size, seeds, m * sizeof *seeds, NULL, 0, values, n * sizeof *values);
    free(head);
    return status;
}

static fmi2Status state(fmi2Component c, uint32_t op, fmi2FMUstate *held) {
    uint64_t value = (uintptr_t)*held;
    const fmi2Status status = called(c, op, &value, sizeof value, NULL, 0, NULL, 0, &value, sizeof value);
    *held = (fmi2FMUstate)(uintptr_t)value;
    return status;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *held) { return state(c, OP_GET_STATE, held); }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate held) { return state(c, OP_SET_STATE, &held); }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *held) { return state(c, OP_FREE_STATE, held); }
