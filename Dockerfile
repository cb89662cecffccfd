# One image a service: docker build --build-arg SERVICE=agent -t treenail/agent .
# SERVICE is router, store, task, classifier, agent, sim, viewer, sensor_jr3 or robot_link; cli is the treenail command with
# all that it can ask.

FROM debian:bookworm-slim AS python
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3 \
    && apt-get clean && rm -rf /var/lib/apt/lists/*

# The wheels of requirements.lock, checked by hash, once for all services.
FROM python AS wheels
RUN apt-get update \
    && apt-get install -y --no-install-recommends g++ python3-dev python3-venv \
    && apt-get clean && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /build
WORKDIR /build
ENV PIP_DISABLE_PIP_VERSION_CHECK=1
COPY requirements.lock .
RUN bin/pip download --quiet --no-cache-dir --require-hashes -r requirements.lock -d wheels
ENV PIP_NO_INDEX=1 PIP_FIND_LINKS=/build/wheels
# ART2's arithmetic as machine code: the image of the classifier is two thirds smaller without the compiler.
RUN bin/pip install --quiet --upgrade setuptools numba
COPY services/classifier/art2_kernel.py services/classifier/compile_kernel.py services/classifier/
RUN bin/python -m services.classifier.compile_kernel /build/compiled

# What one service needs, and nothing else: the extra of its name in pyproject.toml.
FROM wheels AS installed
ARG SERVICE
COPY pyproject.toml .
RUN python3 -c "import tomllib; project = tomllib.load(open('pyproject.toml', 'rb'))['project']; \
needs = project['dependencies'] + project['optional-dependencies'].get('$SERVICE', []); \
print(*(need for need in needs if not need.startswith('numba')), sep='\n')" > needs.txt \
    && python3 -m venv --without-pip /opt/treenail \
    && bin/pip --python /opt/treenail/bin/python install --quiet -r needs.txt \
    && find /opt/treenail -depth -type d -name tests -exec rm -r {} +
COPY services services
COPY experiments experiments
COPY treenail treenail
RUN cp compiled/art2_machine_code*.so services/classifier/ \
    && bin/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist . \
    && bin/pip --python /opt/treenail/bin/python install --quiet --no-deps dist/treenail-*.whl

FROM python
ARG SERVICE
# SAPIEN is linked with X11 even where it draws nothing.
RUN if [ "$SERVICE" = sim ]; then \
        apt-get update && apt-get install -y --no-install-recommends libx11-6 \
        && apt-get clean && rm -rf /var/lib/apt/lists/*; \
    fi
COPY --from=installed /opt/treenail /opt/treenail
# What the store writes; a named volume takes its owner from here.
RUN mkdir /data && chown 10001:10001 /data
USER 10001:10001
WORKDIR /data
ENV PATH=/opt/treenail/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    HOME=/tmp \
    TREENAIL_HEARTBEAT_FILE=/tmp/heartbeat
# The work loop touches the file every second; one that hangs does not.
HEALTHCHECK --interval=5s --timeout=3s --start-period=60s --retries=3 \
    CMD find /tmp/heartbeat -newermt "10 seconds ago" | grep -q .
ENTRYPOINT ["treenail"]
