# Starts nginx with what it cannot ask for itself: where names are looked up, and what the viewer is called.
set -eu
resolver=$(sed -n 's/^nameserver *//p' /etc/resolv.conf | head -n 1)
sed -e "s/RESOLVER/$resolver/" -e "s/VIEWER/${VIEWER:-viewer}/" /etc/front/front.conf >/tmp/front.conf
exec nginx -e stderr -c /tmp/front.conf
