/* A libnvidia-ml.so.1 whose devices are played: $GPUS of them, of which the last one is lost while
 * $LOST is set, or none to whom $DENIED is set. The first one has no counter of energy. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { OK = 0, NOT_SUPPORTED = 3, NO_PERMISSION = 4, NOT_FOUND = 6, TOO_SMALL = 7, LOST = 15 };

typedef struct { unsigned pid; unsigned long long bytes; unsigned instance, compute; } Process;
typedef struct { unsigned pid; unsigned long long at_us; unsigned sm, memory, enc, dec; } Use;

static unsigned count(void) { return getenv("GPUS") ? atoi(getenv("GPUS")) : 0; }

static int state(uintptr_t gpu) { return getenv("LOST") && gpu == count() ? LOST : OK; }

int nvmlInitWithFlags(unsigned flags) { return getenv("DENIED") ? NO_PERMISSION : OK; }

int nvmlDeviceGetCount_v2(unsigned *number) { *number = count(); return OK; }

int nvmlDeviceGetHandleByIndex_v2(unsigned index, uintptr_t *gpu) { *gpu = index + 1; return OK; }

int nvmlDeviceGetName(uintptr_t gpu, char *name, unsigned size) { strcpy(name, "Stub"); return OK; }

int nvmlDeviceGetUtilizationRates(uintptr_t gpu, unsigned *rates) {
    rates[0] = 40;
    rates[1] = 10;
    return state(gpu);
}

int nvmlDeviceGetDecoderUtilization(uintptr_t gpu, unsigned *share, unsigned *period_us) {
    *share = 10;
    return state(gpu);
}

int nvmlDeviceGetEncoderUtilization(uintptr_t gpu, unsigned *share, unsigned *period_us) {
    return NOT_SUPPORTED;
}

int nvmlDeviceGetMemoryInfo(uintptr_t gpu, unsigned long long *total_free_used) {
    total_free_used[2] = 1ull << 30;
    return state(gpu);
}

int nvmlDeviceGetPowerUsage(uintptr_t gpu, unsigned *mw) { *mw = 250000; return state(gpu); }

int nvmlDeviceGetTotalEnergyConsumption(uintptr_t gpu, unsigned long long *mj) {
    static unsigned long long used_mj;
    if (gpu == 1)
        return NOT_SUPPORTED;
    *mj = used_mj += 50000;
    return state(gpu);
}

int nvmlDeviceGetComputeRunningProcesses_v3(uintptr_t gpu, unsigned *number, Process *listed) {
    unsigned room = *number;
    *number = 1;
    if (!room)
        return state(gpu) ? state(gpu) : TOO_SMALL;
    listed[0] = (Process){.pid = atoi(getenv("PID")), .bytes = 1ull << 20};
    return OK;
}

int nvmlDeviceGetGraphicsRunningProcesses_v3(uintptr_t gpu, unsigned *number, Process *listed) {
    return nvmlDeviceGetComputeRunningProcesses_v3(gpu, number, listed);
}

int nvmlDeviceGetProcessUtilization(uintptr_t gpu, Use *used, unsigned *number,
                                    unsigned long long since_us) {
    unsigned room = *number;
    *number = 1;
    if (gpu != 1)
        return NOT_FOUND;
    if (!room)
        return TOO_SMALL;
    used[0] = (Use){.pid = atoi(getenv("PID")), .at_us = since_us + 1, .sm = 30};
    return OK;
}
