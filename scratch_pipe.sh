python3 -m study 7.1 --force --jobs 2 --out /tmp/front-pipe 2>&1 | head -n 1; echo "rc ${PIPESTATUS[*]}"
python3 -m study check --out /tmp/front-pipe | head -n 1; echo "rc ${PIPESTATUS[*]}"
python3 -m study 3 --force --jobs 1 --out /tmp/front-pipe 2>&1 | head -n 1; echo "rc ${PIPESTATUS[*]}"
ls /tmp/front-pipe /tmp/front-pipe/7.1 | wc -l
